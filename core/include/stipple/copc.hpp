#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"
#include "stipple/sampled_octree.hpp"

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace stipple {

struct CopcOptions {
    SampledOctreeOptions octree{};
    std::optional<double>
        precision{};  ///< the largest error per axis, in input units, > 0: the step of the grid is
                      ///< the largest power of ten below twice as much. Absent: see `encode_copc`
    std::optional<unsigned> epsg{};  ///< the coordinate system, one of `is_on_globe`; absent: a
                                     ///< local one of which nothing is known
};

/// A cloud as a Cloud Optimized Point Cloud (COPC 1.0): a LAZ file (LAS 1.4, layered compression),
/// its points in the order of the nodes of a `SampledOctree`, one chunk each, which readers fetch
/// by byte ranges.
///
/// Positions are integers on a grid whose step is a power of ten in input units: the longest on
/// which all of them lie already, as coordinates of LiDAR mostly do; otherwise as short as single
/// precision can resolve, or as `precision` says. With colours the points have format 7 (8 bits in
/// the upper half of 16, as in LAS), otherwise 6. Attributes with the name of a LAS field that can
/// hold their values are stored in it: whole numbers `intensity` and `point_source_id` (up to
/// 65,535), `classification` and `user_data` (up to 255), `return_number` with `number_of_returns`
/// (1 <= number <= count <= 15), finite `gps_time`, and, where they are 0 or 1, the flags
/// `synthetic`, `key_point`, `withheld`, `overlap`, `scan_direction_flag` and
/// `edge_of_flight_line`; in any case, with or without underscores, or with the prefix `scalar_`.
/// Where a field cannot hold the values of some points, at most a tenth of all, it is 0 there (of
/// returns: 1 of 1), and the extra bytes have all; of more, the extra bytes alone. Normals
/// (`NormalX`, `NormalY`, `NormalZ`), alpha and all other attributes become extra bytes in their
/// own types under their names, which LAS limits to 32 characters; an attribute with several
/// components becomes several. Fields without a value are 0 (each point is the only return of its
/// pulse); no date is written.
///
/// @param odd  unless null, set to the attributes that LAS's fields cannot hold at every point, and
/// at how many not, each in words.
/// @throws Error(InvalidArgument) for a cloud without points, options out of range, a precision for
/// which 30 bits are too few, and extra bytes beyond what a record (65,499) and its description
/// (341 of them) can hold.
///
/// O(N log N), mostly parallel: about 0.35 us per point, and 15 ns for each extra byte; the same
/// bytes for any number of threads. 30 bytes per point, and twice the file.
std::vector<std::byte> encode_copc(const PointCloud& cloud, const CopcOptions& options = {},
                                   const RunContext& context = {},
                                   std::vector<std::string>* odd = nullptr);

}  // namespace stipple
