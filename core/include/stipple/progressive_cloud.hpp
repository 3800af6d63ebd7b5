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
    unsigned position_bits = 14;  ///< 1..24 per axis, for the longest side, at the end of the
                                  ///< stream; more if steps would otherwise exceed the spacing
    std::optional<double>
        precision{};  ///< instead of position_bits: the largest error per axis at the end, input
                      ///< units; less than a hundredth of it by single precision is not counted, so
                      ///< that decimal steps stay decimal. Refused if it takes more than 24 bits
    unsigned normal_bits = 8;  ///< 2..16 for each of the two coordinates of a normal, octahedral
    unsigned attribute_bits =
        16;  ///< 1..32 for floats, over the range of each attribute; 0: lossless, as are integers,
             ///< doubles and values that are not finite
    double coarseness = 0.3;  ///< fraction that the grid steps along the stream may add to the mean
                              ///< error of the points so far; >= 0, 0: all bits at once
};

/// A part of a progressive stream, at the end of which all points have the same precision.
struct ProgressiveBatch {
    std::uint64_t points = 0;  ///< from the start of the stream to the end of the batch
    std::uint64_t bytes = 0;   ///< the same, header included
    double step = 0;           ///< of the grid of its points, input units
    double mean_error = 0;     ///< from the surface of the whole cloud to that of the points so far
                               ///< (§4, linear basis), as shown, input units
};

/// Writes a cloud as a stream of which every prefix is a good cloud of fewer points.
///
/// The points come in the reverse of the order in which contraction to one end point (§3.2) removed
/// them, so that the first n are about what `iterative_simplification` keeps for n. Each batch
/// splits the cells of the existing points, then visits the cells around each of them, near the
/// plane of its neighbours, for new ones. docs/progressive-stream.md describes the format.
///
/// @param cloud  finite, distinct positions (`clean`), at least one point.
/// @throws Error(InvalidArgument) for an empty cloud or an option out of range; Error(TooLarge) for
/// 2^31 points or more.
///
/// O(N log N); the same bytes for any number of threads. About 200 bytes per point.
std::vector<std::byte> encode_progressive(const PointCloud& cloud,
                                          const ProgressiveOptions& options = {},
                                          const RunContext& context = {});

/// Decodes a progressive stream piece by piece; its points are available as they come.
class ProgressiveDecoder {
public:
    /// @param most_points  stops at this many: the cloud is then the same however the bytes arrive.
    explicit ProgressiveDecoder(const DecodeLimits& limits = {},
                                std::uint64_t most_points = UINT64_MAX);
    ~ProgressiveDecoder();
    ProgressiveDecoder(ProgressiveDecoder&&) noexcept;
    ProgressiveDecoder& operator=(ProgressiveDecoder&&) noexcept;

    /// The next bytes, any number of them. Anything after the end of the stream is ignored.
    /// @throws Error(MalformedInput) for bytes that are not such a stream, Error(UnsupportedFormat)
    /// for a later version, Error(TooLarge) over a limit. After any of these, or `Cancelled`, it
    /// can only be destroyed.
    ///
    /// Allocates for what arrived, not for what a header claims: for at most 8 points per byte, or
    /// fewer if they have more than 16 channels.
    void feed(std::span<const std::byte> bytes, const RunContext& context = {});

    std::uint64_t size() const noexcept;  ///< points so far
    std::uint64_t total()
        const noexcept;          ///< points of the whole stream; 0 before its header has arrived
    bool done() const noexcept;  ///< no further bytes are needed
    const std::vector<ProgressiveBatch>& batches() const noexcept;  ///< empty before the header

    /// The points so far, in the order of the stream: until all have arrived, moved outwards from
    /// curved parts, so that the surface through them is where that of the whole is; in the end
    /// each in its original place, within half a step per axis. O(n).
    PointCloud cloud(const RunContext& context = {}) const;

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// The cloud of a stream, or of any prefix that holds at least one point.
/// @throws Error(MalformedInput) for a shorter prefix; otherwise like `ProgressiveDecoder::feed`.
PointCloud decode_progressive(std::span<const std::byte> bytes, const DecodeLimits& limits = {},
                              const RunContext& context = {});

}  // namespace stipple
