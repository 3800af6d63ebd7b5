#pragma once

#include "stipple/codec.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

namespace stipple {

/// How a cloud is written as a progressive stream.
struct ProgressiveOptions {
    unsigned position_bits = 14;  ///< 1..24 for each axis of the longest side, at the end; more
                                  ///< where steps would else be longer than the spacing
    std::optional<double>
        precision{};  ///< instead of position_bits: the largest error per axis at the end, input
                      ///< units; what takes more than 24 bits is refused
    unsigned normal_bits = 8;  ///< 2..16 for each of the two coordinates of a normal, octahedral
    unsigned attribute_bits = 16;  ///< 1..32 for floats, over the range of each attribute; 0:
                                   ///< without loss, as are integers, doubles and values that are
                                   ///< not finite
    double coarseness = 0.3;  ///< how much the steps of the grid on the way may add to the mean
                              ///< error of the points that are there, as a part of it; >= 0, 0:
                              ///< all bits at once
};

/// A part of a progressive stream, at whose end all points have the same precision.
struct ProgressiveBatch {
    std::uint64_t points = 0;  ///< from the start of the stream to the end of the batch
    std::uint64_t bytes = 0;   ///< the same, header included
    double step = 0;           ///< of the grid of its points, input units
    double mean_error = 0;     ///< from the surface of the whole cloud to that of the points so far
                               ///< (§4, linear basis), as they are shown, input units
};

/// Writes a cloud as a stream of which every prefix is a good cloud of fewer points.
///
/// The points come in the order in which contraction to one end point (§3.2) took them away, last
/// first, so that the first n are about what `iterative_simplification` keeps of n. Each batch
/// splits the cells of the points that are there, then asks the cells around each of them, near the
/// plane of its neighbours, for new ones. docs/progressive-stream.md has the format.
///
/// @param cloud  finite positions, no two alike (`clean`), at least one point.
/// @throws Error(InvalidArgument) for an empty cloud or an option out of range; Error(TooLarge)
/// from 2^31 points on. O(N log N); the same bytes for any number of threads. About 200 bytes a
/// point.
std::vector<std::byte> encode_progressive(const PointCloud& cloud,
                                          const ProgressiveOptions& options = {},
                                          const RunContext& context = {});

/// Takes a progressive stream piece by piece, and has the points as they come.
class ProgressiveDecoder {
public:
    /// @param most_points  stops when so many are there: the cloud then is the same however the
    /// bytes came.
    explicit ProgressiveDecoder(const DecodeLimits& limits = {},
                                std::uint64_t most_points = UINT64_MAX);
    ~ProgressiveDecoder();
    ProgressiveDecoder(ProgressiveDecoder&&) noexcept;
    ProgressiveDecoder& operator=(ProgressiveDecoder&&) noexcept;

    /// The next bytes, any number of them. What comes behind the end is not looked at.
    /// @throws Error(MalformedInput) for what is no such stream, Error(UnsupportedFormat) for a
    /// later version, Error(TooLarge) over a limit. Allocates for what came, not for what a header
    /// claims: for 8 points a byte at most, for fewer where they have more than 16 channels.
    void feed(std::span<const std::byte> bytes, const RunContext& context = {});

    std::uint64_t size() const noexcept;   ///< points that are there
    std::uint64_t total() const noexcept;  ///< points of the whole stream; 0 before its header is
                                           ///< there
    bool done() const noexcept;            ///< no further byte is needed
    const std::vector<ProgressiveBatch>& batches() const noexcept;  ///< empty before the header

    /// The points so far, in the order of the stream: as long as not all are there, put out of what
    /// is bent, so that the surface through them is where that of the whole is; in the end each
    /// where it was, within half a step for each axis. O(n).
    PointCloud cloud(const RunContext& context = {}) const;

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// The cloud of a stream or of any part of it from its start on that holds at least one point.
/// @throws Error(MalformedInput) for less than that, and as `ProgressiveDecoder::feed`.
PointCloud decode_progressive(std::span<const std::byte> bytes, const DecodeLimits& limits = {},
                              const RunContext& context = {});

}  // namespace stipple
