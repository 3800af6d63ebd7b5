#include "sample_rounds.hpp"

#include <algorithm>
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
    for (std::size_t i = 0; i < more.size(); ++i) round_of_.push_back(round_at[i % rounds]);
    all_.append(more);
}

std::vector<Index> SampleRounds::of_first(unsigned rounds) const {
    std::vector<Index> numbers;
    for (std::size_t i = 0; i < round_of_.size(); ++i)
        if (round_of_[i] < rounds) numbers.push_back(static_cast<Index>(i));
    return numbers;
}

}  // namespace stipple
