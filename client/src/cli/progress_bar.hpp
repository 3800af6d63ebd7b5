#pragma once

#include "cli/terminal.hpp"
#include "stipple/run_context.hpp"

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>

namespace stipple::cli {

/// What a progress line tells.
struct ProgressState {
    std::string stage;    ///< one word
    double fraction = 0;  ///< of all the work, 0..1
    double elapsed = 0;   ///< seconds
    double still = 0;     ///< of these since the fraction grew
};

/// A bar of `cells` columns: eighths of blocks where Unicode is, else `#` and `-`.
std::string progress_bar(double fraction, unsigned cells, const TextStyle& style);
/// `12 s left` once there is something to go by; until then, and where it takes longer than that,
/// what it took so far.
std::string time_note(const ProgressState& state);
/// The whole line, at most `columns - 1` wide; what finds no room is left out, the bar first.
std::string progress_line(const ProgressState& state, const TextStyle& style, unsigned columns);

/// One line at the foot of the terminal, redrawn ten times a second, gone when the display is. Work
/// that is done in a blink shows nothing; nor does anything appear where no terminal is.
class ProgressDisplay {
public:
    explicit ProgressDisplay(const Terminal& terminal, bool wanted = true);
    ~ProgressDisplay();
    ProgressDisplay(const ProgressDisplay&) = delete;
    ProgressDisplay& operator=(const ProgressDisplay&) = delete;

    /// Cheap, and from any thread.
    void update(std::string_view stage, double fraction);
    /// A context whose progress 0..1 appears as `from..to` of this stage. Not for longer than the
    /// display lives.
    RunContext stage(std::string name, double from, double to, RunContext context);
    /// Takes the line away, for good.
    void finish();

private:
    void redraw_until_stopped(std::stop_token stop);

    const Terminal& terminal_;
    const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
    std::mutex mutex_;
    ProgressState state_;  // guarded by mutex_, as is the next
    double grew_ = 0;      // the fraction, so many seconds after the start
    std::condition_variable_any changed_;
    std::jthread painter_;
};

}  // namespace stipple::cli
