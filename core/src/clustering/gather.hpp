#pragma once

#include "cloud/samples.hpp"
#include "clustering/sample_moments.hpp"

#include <algorithm>
#include <limits>
#include <span>

namespace stipple {

/// Copies the points of these numbers to where vector code reads them.
void gather(std::span<const Vec3f> points, std::span<const Index> numbers,
            const MutableSampleSpan& to) noexcept;

/// A sample and how far it is.
struct Near {
    float distance_sq = std::numeric_limits<float>::infinity();
    Index index = std::numeric_limits<Index>::max();
    Vec3f position = Vec3f::Zero();
};

/// The members of clusters, a piece at a time where they are many; the last piece stays, so that a
/// cluster of one piece is gathered once.
class Gathered {
public:
    /// @param ordered  all members of all clusters, as they stand behind each other, where that is
    /// at hand: then nothing is gathered, and lists of members are parts of `ordered.index`.
    explicit Gathered(std::span<const Vec3f> points, const SampleSpan& ordered = {})
        : points_(points), ordered_(ordered), storage_(ordered.size > 0 ? 0 : kPiece) {}

    /// Calls `visit` with the samples of each piece.
    template <typename Visit>
    void each_piece(std::span<const Index> members, Visit&& visit) {
        for (std::size_t begin = 0; begin < members.size(); begin += kPiece) {
            const auto piece = members.subspan(begin, std::min(kPiece, members.size() - begin));
            if (ordered_.size > 0) {
                const std::size_t at = place_of(piece);
                visit(ordered_.part(at, at + piece.size()));
                continue;
            }
            const MutableSampleSpan samples = storage_.all().part(0, piece.size());
            if (piece.data() != last_) gather(points_, piece, samples);
            last_ = piece.data();
            visit(SampleSpan(samples));
        }
    }

    /// Of a cluster of at least one.
    SampleMoments moments_of(std::span<const Index> members) {
        const Vec3f first = first_of(members);
        SampleSums sums{};
        each_piece(members, [&](const SampleSpan& samples) {
            const SampleSums part =
                cluster_kernels().sums(samples, {first.x(), first.y(), first.z()});
            for (std::size_t k = 0; k < sums.size(); ++k) sums[k] += part[k];
        });
        return moments_from(sums, members.size(), first.cast<double>());
    }

    /// The member nearest to `target`; the smaller number among equals.
    Near nearest_to(const Vec3f& target, std::span<const Index> members);

private:
    static constexpr std::size_t kPiece = 4'096;

    Vec3f first_of(std::span<const Index> members) const noexcept {
        return ordered_.size > 0 ? ordered_.position(place_of(members)) : points_[members.front()];
    }
    std::size_t place_of(std::span<const Index> members) const noexcept {
        return static_cast<std::size_t>(members.data() - ordered_.index);
    }

    std::span<const Vec3f> points_;
    SampleSpan ordered_;
    Samples storage_;
    const Index* last_ = nullptr;
};

}  // namespace stipple
