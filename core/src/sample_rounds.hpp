#pragma once

#include "error_samples.hpp"
#include "stipple/point_cloud.hpp"

#include <cstdint>
#include <vector>

namespace stipple {

/// Places to measure at, on a surface and along a curve, in rounds of up to `kRound`, each spread
/// over all of it: so many rounds are taken as tell an error well.
class SampleRounds {
public:
    static constexpr std::uint64_t kRound = 4'096;
    static constexpr unsigned kMostRounds = 32;

    const ErrorSamples& all() const noexcept { return all_; }
    unsigned rounds() const noexcept { return rounds_; }

    /// @param more  of so many rounds, no more than `kMostRounds` with those that there are.
    void add(const ErrorSamples& more, unsigned rounds);

    /// The numbers of those of the first rounds, ascending.
    std::vector<Index> of_first(unsigned rounds) const;

private:
    ErrorSamples all_;
    std::vector<std::uint8_t> round_of_;
    unsigned rounds_ = 0;
};

}  // namespace stipple
