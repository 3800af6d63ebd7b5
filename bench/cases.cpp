#include "cases.hpp"

#include "peers.hpp"
#include "stipple/codec.hpp"
#include "stipple/hierarchical_clustering.hpp"
#include "stipple/lod_pyramid.hpp"
#include "stipple/lod_tiles.hpp"
#include "stipple/neighbors.hpp"
#include "stipple/outliers.hpp"
#include "stipple/proto/thousands.hpp"

#include <fcntl.h>
#include <unistd.h>
#include <cstring>
#include <memory>
#include <span>
#include <stdexcept>

namespace stipple::bench {

namespace fs = std::filesystem;

namespace {

HierarchicalClusteringOptions exactly(std::uint64_t target, Representative representative) {
    HierarchicalClusteringOptions options;
    options.target_size = target;
    options.representative = representative;
    return options;
}

/// All bytes of the file by read(), the least that any reader must do.
void read_all(const fs::path& file, std::span<std::byte> bytes) {
    const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
    if (descriptor < 0) throw std::runtime_error("cannot open " + file.string());
    while (!bytes.empty()) {
        const ssize_t got = ::read(descriptor, bytes.data(), bytes.size());
        if (got <= 0) break;
        bytes = bytes.subspan(static_cast<std::size_t>(got));
    }
    ::close(descriptor);
    if (!bytes.empty()) throw std::runtime_error("cannot read " + file.string());
}

/// Reads into memory that was touched before, or into fresh memory as a reader of one file has to.
Contestant raw_bytes(const fs::path& file, bool touched_before) {
    const std::size_t size = fs::file_size(file);
    const auto buffer = std::make_shared<std::unique_ptr<std::byte[]>>();
    return {.name = touched_before ? "read() into a warm buffer" : "read() into a fresh buffer",
            .run = [=]() -> std::any {
                if (!touched_before) *buffer = std::make_unique_for_overwrite<std::byte[]>(size);
                read_all(file, {buffer->get(), size});
                return {};
            },
            .prepare =
                [=] {
                    buffer->reset();
                    if (!touched_before) return;
                    *buffer = std::make_unique_for_overwrite<std::byte[]>(size);
                    std::memset(buffer->get(), 1, size);
                }};
}

/// How much of `ours` has the same distances in `theirs`, of 1. Indices may differ among equals.
double agreement(const NeighborLists& ours, const NeighborLists& theirs) {
    if (ours.offsets != theirs.offsets) return 0;
    std::size_t same = 0;
    for (std::size_t i = 0; i < ours.distances_sq.size(); ++i)
        same +=
            std::abs(ours.distances_sq[i] - theirs.distances_sq[i]) <= 1e-6F * ours.distances_sq[i];
    return static_cast<double>(same) / static_cast<double>(ours.distances_sq.size());
}

}  // namespace

void read_ply(Session& session, const std::string& name, const std::string& model_name,
              bool ascii) {
    const fs::path file = session.models().ply_file(model_name, ascii);
    const Model& model = session.models().get(model_name);
    const std::size_t points = model.synthetic() ? model.cloud.size() : model.mesh.vertices.size();
    const std::size_t triangles = model.synthetic() ? 0 : model.mesh.triangles.size();
    for (const unsigned threads : session.options().threads) {
        std::vector<Contestant> contestants;
        contestants.push_back({.name = "stipple read_cloud", .run = [=]() -> std::any {
                                   return read_cloud(file, {}, on_threads(threads));
                               }});
        for (const Peer& peer : reading_peers(file))
            contestants.push_back(contestant(peer, threads));
        contestants.push_back(raw_bytes(file, false));
        contestants.push_back(raw_bytes(file, true));
        session.contest({.name = name,
                         .threads = threads,
                         .work = model_name + ": " + proto::with_separators(points) + " points, " +
                                 proto::with_separators(triangles) + " triangles, " +
                                 proto::with_separators(fs::file_size(file)) + " bytes " +
                                 (ascii ? "of text" : "in little endian"),
                         .units = points},
                        std::move(contestants));
    }
}

void neighbors(Session& session, const std::string& name, const std::string& model_name,
               unsigned k) {
    const Model& model = session.models().get(model_name);
    const std::span<const Vec3f> points = model.cloud.positions;
    for (const unsigned threads : session.options().threads) {
        const auto ours = std::make_shared<NeighborLists>();
        std::vector<Contestant> contestants;
        contestants.push_back({.name = "stipple k_nearest_neighbors",
                               .run = [=]() -> std::any {
                                   return k_nearest_neighbors(points, k, on_threads(threads));
                               },
                               .figures =
                                   [=](const std::any& value) {
                                       *ours = std::any_cast<const NeighborLists&>(value);
                                       return std::vector<Figure>{};
                                   }});
        contestants.push_back(
            {.name = "nanoflann",
             .run = [=]() -> std::any { return nanoflann_nearest_neighbors(points, k, threads); },
             .figures =
                 [=](const std::any& value) {
                     const double same =
                         agreement(*ours, std::any_cast<const NeighborLists&>(value));
                     *ours = {};
                     return std::vector<Figure>{{"% same distances", 100 * same, 3}};
                 }});
        session.contest({.name = name,
                         .threads = threads,
                         .work = described(model) + ", k = " + std::to_string(k) +
                                 ", index built and all lists written",
                         .units = points.size()},
                        std::move(contestants));
    }
}

void outliers(Session& session, const std::string& name, const std::string& model_name) {
    const Model& model = session.models().get(model_name);
    const std::span<const Vec3f> points = model.cloud.positions;
    for (const unsigned threads : session.options().threads) {
        std::vector<Contestant> contestants;
        contestants.push_back(
            {.name = "stipple find_outliers",
             .run = [=]() -> std::any { return find_outliers(points, {}, on_threads(threads)); },
             .figures =
                 [](const std::any& value) {
                     const auto found = std::any_cast<const std::vector<Index>&>(value).size();
                     return std::vector<Figure>{{"found", static_cast<double>(found), 3}};
                 }});
        session.contest({.name = name,
                         .threads = threads,
                         .work = described(model) + ": index built and all outliers listed",
                         .units = points.size()},
                        std::move(contestants));
    }
}

void pyramid(Session& session, const std::string& name, const std::string& model_name) {
    const Model& model = session.models().get(model_name);
    for (const unsigned threads : session.options().threads) {
        const LodPyramidOptions options{.spacing = false};
        const std::vector<std::uint64_t> sizes = lod_sizes(model.cloud.size(), options);
        std::vector<Contestant> contestants;
        contestants.push_back(
            {.name = "stipple build_lod_pyramid", .run = [=, &model]() -> std::any {
                 build_lod_pyramid(
                     model.cloud, options, [](LodLevel&&) {}, on_threads(threads));
                 return {};
             }});
        if (sizes.size() > 1)
            contestants.push_back(
                {.name = "its finest cut alone", .run = [=, &model]() -> std::any {
                     const std::uint64_t finest = sizes[sizes.size() - 2];
                     return hierarchical_clustering(model.cloud,
                                                    exactly(finest, Representative::Nearest),
                                                    on_threads(threads));
                 }});
        session.contest({.name = name,
                         .threads = threads,
                         .work = described(model) + ", " + std::to_string(sizes.size()) +
                                 " levels from " + proto::with_separators(sizes.front()),
                         .units = model.cloud.size()},
                        std::move(contestants));
    }
}

void tiles(Session& session, const std::string& name, const std::string& model_name) {
    const Model& model = session.models().get(model_name);
    for (const unsigned threads : session.options().threads) {
        const RunContext context = on_threads(threads);
        const LodPyramidOptions options{.spacing = false};
        const std::vector<std::uint64_t> sizes = lod_sizes(model.cloud.size(), options);
        std::vector<Contestant> contestants;
        contestants.push_back(
            {.name = "all levels and their tiles", .run = [=, &model]() -> std::any {
                 LodTiler tiler(model.cloud, {}, context);
                 LodPyramidOptions in_order = options;
                 in_order.order = tiler.order();
                 build_lod_pyramid(
                     model.cloud, in_order,
                     [&](LodLevel&& level) {
                         tiler.add_level(level.cloud, level.cloud.size() == sizes.back(), context,
                                         level.order);
                     },
                     context);
                 return {};
             }});
        contestants.push_back(
            {.name = "the tiles of the finest level alone", .run = [=, &model]() -> std::any {
                 LodTiler(model.cloud, {}, context).add_level(model.cloud, true, context);
                 return {};
             }});
        contestants.push_back({.name = "all levels alone", .run = [=, &model]() -> std::any {
                                   build_lod_pyramid(
                                       model.cloud, options, [](LodLevel&&) {}, context);
                                   return {};
                               }});
        session.contest(
            {.name = name,
             .threads = threads,
             .work = described(model) + ", " + std::to_string(sizes.size()) + " levels from " +
                     proto::with_separators(sizes.front()) + ", tiles measured and encoded",
             .units = model.cloud.size()},
            std::move(contestants));
    }
}

void encode(Session& session, const std::string& name, const std::string& model_name) {
    const Model& model = session.models().get(model_name);
    const auto size_figure = [&model](const std::any& value) {
        const auto bytes =
            static_cast<double>(std::any_cast<const std::vector<std::byte>&>(value).size());
        return std::vector<Figure>{
            {"bits/point", 8 * bytes / static_cast<double>(model.cloud.size())}};
    };
    const auto draco = [&](const std::string& coding_name, DracoCoding coding) {
        return Contestant{.name = coding_name,
                          .run = [=, &model]() -> std::any {
                              return encode_draco(model.cloud, {.coding = coding, .precision = {}},
                                                  on_threads(1));
                          },
                          .figures = size_figure};
    };
    std::vector<Contestant> contestants;
    contestants.push_back(draco("Draco kd-tree, 14 bits", DracoCoding::KdTree));
    contestants.push_back(draco("Draco sequential, 14 bits", DracoCoding::Sequential));
    contestants.push_back({.name = "PLY little endian",
                           .run = [&model]() -> std::any { return encode_ply(model.cloud); },
                           .figures = size_figure});
    session.contest(
        {.name = name, .threads = 1, .work = described(model), .units = model.cloud.size()},
        std::move(contestants));
}

}  // namespace stipple::bench
