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

/// What is wanted of a pyramid: a budget, a place, a format. Exactly one of the budgets is set.
struct SliceOptions {
    std::optional<std::uint64_t> points{};  ///< at least 1: exactly so many; all there are when
                                            ///< there are fewer
    std::optional<std::uint64_t> bytes{};   ///< of the encoded cloud: at most, and no more than
                                           ///< about 2 % less where there are points for it
    std::optional<double> max_error{};      ///< > 0, input units: the coarsest level whose maximum
                                            ///< error is within it, whole
    std::optional<double> max_error_rel{};  ///< > 0: the same, as a part of the diagonal of the
                                            ///< source's box
    std::optional<Aabb> box{};  ///< in the coordinates of the file; its faces belong to it
    CloudFormat format = CloudFormat::Ply;  ///< not a progressive stream
    DracoEncodeOptions draco{};
    std::uint64_t max_points = 1'000'000;  ///< that are returned
};

/// @throws Error(InvalidArgument) for no budget or several, or for one out of range; for a box
/// whose least corner is not below its largest; for a format that slices do not have.
void validate(const SliceOptions& options);

/// The query of `GET /v1/pyramids/{id}/slice`: `points=5000&box=0,0,0,1,1,1&format=drc`.
std::string slice_query(const SliceOptions& options);

/// A cloud cut from a pyramid, encoded.
struct Slice {
    std::vector<std::byte> bytes;
    std::uint64_t points = 0;
    unsigned level = 0;  ///< from which it was cut
    /// Distances from the surface of the source, input units; absent where the pyramid's were not
    /// measured. Those of the level, with what the format may round at most; of a trimmed cloud
    /// what trimming added is measured and added (`estimate_error`): no less than its own, by the
    /// triangle inequality, as far as was sampled.
    std::optional<double> error_mean, error_max;
};

/// The bytes of a file of a pyramid.
using FileReader = std::function<std::vector<std::byte>(const OutputFile&)>;

/// Cuts a cloud from a finished pyramid, in time proportional to the points of the level that it is
/// cut from, in the box: with levels of ratio 4 at most four times those returned.
///
/// The level is the coarsest that has the points asked for in the box; it is then simplified to the
/// exact count by the method of the pyramid. A level is read from its PLY file, with all attributes
/// and unrounded; with a box, and where there is no PLY file, from those of its tiles (`glb`) that
/// meet the box, with the attributes that tiles have: 32-bit integers and doubles as floats there,
/// so that where tiles have such attributes (`LodTileOptions::attributes`) a PLY file is read whole
/// for a box, too. Draco files are not read: their decoder needs a process of its own.
///
/// The format `glb` is one tile of up to 65,536 points, in the coordinates of the file, y up.
///
/// @throws Error(InvalidArgument) as `validate`, for a budget that nothing fits, and for a pyramid
/// that has Draco levels alone; Error(NotFound) when no point lies in the box; Error(TooLarge) for
/// more than `max_points`; Error(MalformedInput) for files that are not what the manifest says.
Slice slice_pyramid(const Results& pyramid, const SliceOptions& options, const FileReader& read,
                    const RunContext& context = {});

}  // namespace stipple::proto
