#pragma once

#include "stipple/error.hpp"
#include "stipple/lod_pyramid.hpp"
#include "stipple/proto/digest.hpp"
#include "stipple/proto/slice.hpp"
#include "stipple/proto/tiles.hpp"
#include "stipple/surface_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

// Pyramids that slices are cut from.

namespace stipple::proto {

using Formats = std::vector<CloudFormat>;

/// A pyramid in memory, which counts what is read of it.
struct Pyramid {
    Results results;
    std::map<std::string, std::vector<std::byte>> files;
    mutable std::size_t reads = 0, bytes_read = 0;

    Pyramid(const PointCloud& cloud, std::vector<std::uint64_t> sizes, const Formats& formats,
            std::uint32_t max_points = 1000, bool adds = false, bool tile_attributes = false) {
        PyramidJob job;
        job.options.sizes = std::move(sizes);
        job.options.nested = adds;
        if (adds) job.options.simplification.method = Method::Iterative;
        job.tiles = {.max_points = max_points, .attributes = tile_attributes, .additive = adds};
        results = {.request = {std::string(64, 'a'), job},
                   .source = CloudStatistics{},
                   .levels = {},
                   .complete = true,
                   .cost = {}};
        results.source->bounds = bounds(cloud);
        LodTiler tiler(cloud, job.tiles);
        build_lod_pyramid(cloud, job.options, [&](LodLevel&& level) {
            OutputCloud& made = results.levels.emplace_back();
            made.level = level.level;
            made.points = level.cloud.size();
            made.bounds = bounds(level.cloud);
            made.origin = level.cloud.origin;
            made.attributes = attributes_of(level.cloud);
            const bool whole = level.cloud.size() == cloud.size();
            const SurfaceErrorOptions options;
            made.error =
                error_figures(whole ? SurfaceError{} : measure_error(cloud, level.cloud, options),
                              options, cloud.size(), level.cloud.size());
            for (const CloudFormat format : formats) {
                if (format == CloudFormat::Glb) {
                    for (LodTile& tile : tiler.add_level(level.cloud, whole)) {
                        std::vector<std::byte> bytes = encode_glb(tile);
                        tile.streams.clear();
                        add(made, format, std::move(bytes), std::move(tile));
                    }
                    made.decoded = tiler.figures();
                } else {
                    add(made, format,
                        format == CloudFormat::Ply ? encode_ply(level.cloud)
                                                   : encode_draco(level.cloud),
                        {});
                }
            }
        });
    }

    void add(OutputCloud& level, CloudFormat format, std::vector<std::byte> bytes,
             std::optional<LodTile> tile) {
        const std::string name = sha256_hex(bytes);
        level.files.push_back({format, bytes.size(), name, name, std::move(tile)});
        files[name] = std::move(bytes);
    }

    Slice slice(const SliceOptions& options) const {
        reads = bytes_read = 0;
        return slice_pyramid(results, options, [this](const OutputFile& file) {
            ++reads;
            bytes_read += file.bytes;
            return files.at(file.sha256);
        });
    }
};

inline PointCloud cloud_of(const Slice& slice) {
    return decode_cloud(slice.bytes);
}

inline const PointCloud& source() {
    static const PointCloud cloud = test::with_attributes(test::sphere(8000));
    return cloud;
}

inline const Pyramid& both() {
    static const Pyramid pyramid(source(), {200, 1000, 4000, 8000},
                                 {CloudFormat::Ply, CloudFormat::Glb});
    return pyramid;
}

inline const Aabb kEighth{Vec3d(0, 0, 0), Vec3d(2, 2, 2)};

inline std::string refusal_text(const Pyramid& pyramid, const SliceOptions& options) {
    try {
        pyramid.slice(options);
    } catch (const Error& error) {
        return error.what();
    }
    return "accepted";
}

inline ErrorCode refusal(const Pyramid& pyramid, const SliceOptions& options) {
    try {
        pyramid.slice(options);
    } catch (const Error& error) {
        return error.code();
    }
    ADD_FAILURE() << "nothing was refused";
    return ErrorCode::Internal;
}

}  // namespace stipple::proto
