#pragma once

#include "stipple/proto/results.hpp"
#include "stipple/run_context.hpp"

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace stipple::proto {

/// What to cut from a pyramid: a budget, a place, a format. Exactly one of the budgets is set.
struct SliceOptions {
    std::optional<std::uint64_t> points{};  ///< at least 1: exactly this many, or all if there are
                                            ///< fewer
    std::optional<std::uint64_t> bytes{};   ///< size limit of the encoded cloud, which fills it to
                                            ///< about 2 % if there are enough points
    std::optional<double> max_error{};      ///< > 0, input units: the whole of the coarsest level
                                            ///< whose maximum error is within this
    std::optional<double> max_error_rel{};  ///< > 0: the same, as a fraction of the diagonal of the
                                            ///< source's box
    std::optional<Aabb> box{};  ///< in the coordinates of the file; points on its faces are inside,
                                ///< and those that the tiles' rounding may have taken outside
    CloudFormat format = CloudFormat::Ply;  ///< not a progressive stream
    DracoEncodeOptions draco{};
    std::uint64_t max_points = 1'000'000;  ///< most points returned
    std::uint64_t max_read_bytes = 256U << 20;  ///< most memory of the points of a level that are read
};

/// @throws Error(InvalidArgument) for no budget or several, or one out of range; for a box whose
/// minimum corner is above its maximum; for a format that slices do not offer.
void validate(const SliceOptions& options);

/// The query of `GET /v1/pyramids/{id}/slice`: `points=5000&box=0,0,0,1,1,1&format=drc`.
std::string slice_query(const SliceOptions& options);

/// A cloud cut from a pyramid, encoded.
struct Slice {
    std::vector<std::byte> bytes;
    std::uint64_t points = 0;
    unsigned level = 0;            ///< the level it was cut from
    Vec3d origin = Vec3d::Zero();  ///< to be added to the positions of a Draco file: 0 unless the
                                   ///< source has double coordinates
    /// Distances from the surface of the source, input units; absent if the pyramid's were not
    /// measured. They are those of the level, plus the largest rounding of the format, plus, for a
    /// trimmed cloud, the measured error of trimming (`estimate_error`). That sum is an estimate:
    /// usually larger than the cloud's own error, and no bound, as trimming is measured at some
    /// places alone.
    std::optional<double> error_mean, error_max;
};

/// The bytes of a file of a pyramid.
using FileReader = std::function<std::vector<std::byte>(const OutputFile&)>;

/// Cuts a cloud from a finished pyramid, in time proportional to the points in the box of the level
/// that it is cut from: with levels of ratio 4, at most four times those returned.
///
/// The level is the coarsest with enough points in the box; it is then simplified to the exact
/// count by the method of the pyramid. A level is read from its PLY file, with all attributes and
/// unrounded. With a box, or without a PLY file, it is read from the tiles (`glb`) that meet the
/// box, with the attributes that tiles have. Tiles hold 32-bit integers and doubles as floats, so
/// if they have such attributes (`LodTileOptions::attributes`), a PLY file is read whole for a box,
/// too. Draco files are not read: their decoder needs its own process. Points of tiles that are up
/// to half a step outside the box are moved onto its faces: they may have been there before
/// rounding.
///
/// The format `glb` is one tile of up to 65,536 points, in the coordinates of the file, y up.
///
/// @throws Error(InvalidArgument) like `validate`, for a budget that nothing fits, and for a
/// pyramid with only Draco levels; Error(NotFound) if no point lies in the box; Error(TooLarge) for
/// more than `max_points` or `max_read_bytes`; Error(MalformedInput) for files that contradict the manifest.
Slice slice_pyramid(const Results& pyramid, const SliceOptions& options, const FileReader& read,
                    const RunContext& context = {});

}  // namespace stipple::proto
