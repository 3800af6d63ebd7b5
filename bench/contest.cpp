#include "contest.hpp"

#include <malloc.h>
#include <algorithm>
#include <ctime>
#include <fstream>
#include <sstream>

namespace stipple::bench {

namespace {

double seconds(clockid_t clock) {
    timespec now{};
    ::clock_gettime(clock, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// A `VmRSS` or `VmHWM` line of the process, in bytes; 0 where there is no /proc.
std::size_t status_bytes(const std::string& field) {
    std::ifstream status("/proc/self/status");
    for (std::string line; std::getline(status, line);) {
        if (!line.starts_with(field + ":")) continue;
        std::size_t kilobytes = 0;
        std::istringstream(line.substr(field.size() + 1)) >> kilobytes;
        return kilobytes * 1024;
    }
    return 0;
}

void reset_peak() {
    std::ofstream("/proc/self/clear_refs") << "5";
}

/// Large blocks come from the system and go back to it, as they do in a process that has just
/// begun. Else glibc takes more and more of them from its heap, and what is free there but not
/// given back counts as memory of whoever is next: measured was twice what a contestant needs.
void keep_large_blocks_apart() {
    constexpr int kLarge = 128 * 1024;  // as glibc has it at first
    ::mallopt(M_MMAP_THRESHOLD, kLarge);
}

std::any run_once(const Contestant& contestant, Timing& timing) {
    contestant.prepare();
    ::malloc_trim(0);
    reset_peak();
    const std::size_t before = status_bytes("VmRSS");
    const double wall = seconds(CLOCK_MONOTONIC), cpu = seconds(CLOCK_PROCESS_CPUTIME_ID);
    std::any value = contestant.run();
    timing.wall_s = seconds(CLOCK_MONOTONIC) - wall;
    timing.cpu_s = seconds(CLOCK_PROCESS_CPUTIME_ID) - cpu;
    const std::size_t peak = status_bytes("VmHWM");
    timing.peak_bytes = peak > before ? peak - before : 0;
    return value;
}

double median(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    const std::size_t half = values.size() / 2;
    return values.size() % 2 == 1 ? values[half] : 0.5 * (values[half - 1] + values[half]);
}

std::vector<double> times(const Standing& standing, double Timing::*time) {
    std::vector<double> values;
    for (const Timing& run : standing.runs) values.push_back(run.*time);
    return values;
}

}  // namespace

double Standing::median_wall() const {
    return median(times(*this, &Timing::wall_s));
}
double Standing::median_cpu() const {
    return median(times(*this, &Timing::cpu_s));
}
double Standing::best_wall() const {
    return std::ranges::min(times(*this, &Timing::wall_s));
}
double Standing::worst_wall() const {
    return std::ranges::max(times(*this, &Timing::wall_s));
}

std::size_t Standing::peak_bytes() const {
    return std::ranges::max_element(runs, {}, &Timing::peak_bytes)->peak_bytes;
}

bool Standing::is_above_stated() const {
    return stated_bytes > 0 && peak_bytes() > stated_bytes;
}

std::vector<Standing> hold_contest(const std::vector<Contestant>& contestants, unsigned rounds,
                                   double patience_s) {
    keep_large_blocks_apart();
    std::vector<Standing> standings;
    std::vector<double> spent;
    for (const Contestant& contestant : contestants) {
        Timing warm_up;
        const std::any value = run_once(contestant, warm_up);
        standings.push_back(
            {contestant.name, {}, contestant.figures(value), contestant.stated_bytes});
        contestant.release();
        spent.push_back(warm_up.wall_s);
        if (warm_up.wall_s >= patience_s) standings.back().runs.push_back(warm_up);
    }
    for (unsigned round = 0; round < rounds; ++round)
        for (std::size_t i = 0; i < contestants.size(); ++i) {
            if (spent[i] >= patience_s) continue;
            run_once(contestants[i], standings[i].runs.emplace_back());
            contestants[i].release();
            spent[i] += standings[i].runs.back().wall_s;
        }
    return standings;
}

double median_ratio(const Standing& ours, const Standing& other, double Timing::*time) {
    std::vector<double> ratios;
    for (std::size_t i = 0; i < std::min(ours.runs.size(), other.runs.size()); ++i)
        ratios.push_back(other.runs[i].*time / ours.runs[i].*time);
    return median(ratios);
}

}  // namespace stipple::bench
