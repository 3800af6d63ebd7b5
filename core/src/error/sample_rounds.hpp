#pragma once

#include "error/error_samples.hpp"
#include "stipple/point_cloud.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace stipple {

/// Places to measure at, on a surface and along a curve, in rounds, mostly of `kRound`, each spread
/// over all of it: so many rounds are taken as tell an error well.
class SampleRounds {
public:
    static constexpr std::uint64_t kRound = 1'024;
    static constexpr unsigned kMostRounds = 128;

    const ErrorSamples& all() const noexcept { return all_; }
    unsigned rounds() const noexcept { return rounds_; }

    /// @param more  of so many rounds, no more than `kMostRounds` with those that there are.
    void add(const ErrorSamples& more, unsigned rounds);

    /// The numbers of those of some rounds, along the curve as far as they have numbers of points.
    std::vector<Index> between(unsigned first, unsigned end) const;
    std::vector<Index> of_first(unsigned rounds) const { return between(0, rounds); }

    /// Divides the areas of some places by those by which they were drawn, and notes from
    /// where on their feet are doubtful.
    void weigh(std::span<const Index> numbers, const PointAreas& around);

private:
    ErrorSamples all_;
    std::vector<std::uint8_t> round_of_;
    std::vector<Index> along_curve_;
    unsigned rounds_ = 0;
};

}  // namespace stipple
