#include "evaluation_notes.hpp"

#include "stipple/proto/evaluation.hpp"
#include "stipple/proto/thousands.hpp"

#include <array>
#include <cstdio>

namespace stipple::proto {

namespace {

std::string short_number(double value) {
    std::array<char, 64> text{};
    std::snprintf(text.data(), text.size(), "%.3g", value);
    return text.data();
}

}  // namespace

std::vector<std::string> error_notes(std::uint64_t points, const SurfaceError& error) {
    const auto share = [&error](double distance) {
        return short_number(100 * relative(distance, error)) + " %";
    };
    return {with_separators(points) + (points == 1 ? " point" : " points"),
            "mean " + short_number(error.mean()) + " (" + share(error.mean()) + ") · max " +
                short_number(error.max()) + " (" + share(error.max()) + ")"};
}

std::string distance_legend(double range, const SurfaceError& error) {
    return "distance from the reference, input units (" + short_number(range) + " is " +
           short_number(100 * relative(range, error)) + " % of the diagonal)";
}

}  // namespace stipple::proto
