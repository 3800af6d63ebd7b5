#pragma once

#include <any>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

namespace stipple::bench {

/// A number that a contestant shows beside its times.
struct Figure {
    std::string name;
    double value = 0;
    int decimals = 2;
};

/// One way to do the work of a case.
struct Contestant {
    std::string name;
    std::function<std::any()> run;          ///< timed; the value is freed outside the timed part
    std::function<void()> prepare = [] {};  ///< before each run, not timed
    std::function<std::vector<Figure>(const std::any&)> figures = [](const std::any&) {
        return std::vector<Figure>{};
    };                                      ///< of the warm-up's value
    std::function<void()> release = [] {};  ///< after each run and its figures, not timed
    std::size_t stated_bytes = 0;  ///< memory that it says it needs at most; 0: it does not say
};

struct Timing {
    double wall_s = 0;
    double cpu_s = 0;            ///< of all threads
    std::size_t peak_bytes = 0;  ///< largest resident set over what stood before
};

struct Standing {
    std::string name;
    std::vector<Timing> runs;
    std::vector<Figure> figures;
    std::size_t stated_bytes = 0;

    double median_wall() const;
    double median_cpu() const;
    double best_wall() const;  ///< what a busy machine spoils least
    double worst_wall() const;
    std::size_t peak_bytes() const;
    bool is_above_stated() const;  ///< whether it took more memory than it says
};

/// Runs the contestants in turn, A B C A B C, after one round of warm-up. The heap is trimmed
/// before each run, since nodes left by one would slow down the next (CGAL's lists by 2 to 4
/// times). Who has run for `patience_s` in all sits out the rest; a warm-up that took as long is
/// that contestant's only run.
std::vector<Standing> hold_contest(const std::vector<Contestant>& contestants, unsigned rounds,
                                   double patience_s);

/// How many times as long `other` took as `ours`: the median over the rounds that both ran in.
double median_ratio(const Standing& ours, const Standing& other, double Timing::*time);

}  // namespace stipple::bench
