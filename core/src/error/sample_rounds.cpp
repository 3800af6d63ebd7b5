#include "error/sample_rounds.hpp"

#include <algorithm>
#include <limits>
#include <numeric>

namespace stipple {

void SampleRounds::add(const ErrorSamples& more, unsigned rounds) {
    // Of as many places that follow each other one goes to each round; by the bits of their numbers
    // backwards, so that those of the first rounds lie as far apart as can be.
    std::vector<unsigned> turns(rounds);
    std::iota(turns.begin(), turns.end(), 0U);
    std::ranges::sort(turns, {}, [](unsigned turn) {
        unsigned backwards = 0;
        for (unsigned bit = 1; bit < kMostRounds; bit *= 2)
            backwards = 2 * backwards + ((turn & bit) != 0 ? 1 : 0);
        return backwards;
    });
    std::vector<std::uint8_t> round_at(rounds);
    for (const unsigned turn : turns) round_at[turn] = static_cast<std::uint8_t>(rounds_++);
    const std::size_t so_far = all_.size();
    for (std::size_t i = 0; i < more.size(); ++i) {
        round_of_.push_back(round_at[i % rounds]);
        along_curve_.push_back(static_cast<Index>(so_far + i));
    }
    all_.append(more);
    all_.doubtful_sq.resize(all_.size(), std::numeric_limits<float>::infinity());
    if (all_.numbers.size() < all_.size()) return;
    std::ranges::inplace_merge(along_curve_,
                               along_curve_.begin() + static_cast<std::ptrdiff_t>(so_far), {},
                               [&](Index place) { return all_.numbers[place]; });
}

std::vector<Index> SampleRounds::between(unsigned first, unsigned end) const {
    std::vector<Index> numbers;
    for (const Index place : along_curve_)
        if (round_of_[place] >= first && round_of_[place] < end) numbers.push_back(place);
    return numbers;
}

void SampleRounds::weigh(std::span<const Index> numbers, const PointAreas& around) {
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        all_.areas[numbers[i]] = around.areas[i] / all_.areas[numbers[i]];
        all_.doubtful_sq[numbers[i]] = around.doubtful_sq[i];
    }
}

}  // namespace stipple
