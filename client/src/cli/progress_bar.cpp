#include "cli/progress_bar.hpp"

#include "cli/units.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <utility>

namespace stipple::cli {
namespace {

constexpr unsigned kStageColumns = 9;  // as long as the longest stage, so that the bar stands still
constexpr unsigned kLongestBar = 40, kShortestBar = 8;

std::string repeated(std::string_view text, std::size_t times) {
    std::string result;
    for (std::size_t i = 0; i < times; ++i) result += text;
    return result;
}

std::string padded(std::string text, std::size_t columns) {
    if (text.size() < columns) text.append(columns - text.size(), ' ');
    return text;
}

std::string percent(double fraction) {
    // Never 100 before the end: nothing irritates more than a bar that is full and stays.
    const int value = std::min(99, static_cast<int>(std::floor(100.0 * fraction + 1e-9)));
    return (value < 10 ? " " : "") + std::to_string(value) + " %";
}

double seconds_since(std::chrono::steady_clock::time_point start) {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

std::string progress_bar(double fraction, unsigned cells, const TextStyle& style) {
    fraction = std::clamp(fraction, 0.0, 1.0);
    if (!style.unicode) {
        const auto full = static_cast<std::size_t>(fraction * cells);
        return "[" + std::string(full, '#') + std::string(cells - full, '-') + "]";
    }
    static constexpr std::array<std::string_view, 8> kPart = {"",  "▏", "▎", "▍",
                                                              "▌", "▋", "▊", "▉"};
    const auto eighths = static_cast<std::size_t>(std::lround(fraction * cells * 8));
    const std::string done = repeated("█", eighths / 8) + std::string(kPart[eighths % 8]);
    const std::string rest(cells - eighths / 8 - (eighths % 8 != 0 ? 1 : 0), ' ');
    if (!style.color) return "▕" + done + rest + "▏";
    // A quiet ground under the blocks: their unfinished eighths then join it without a seam.
    return "\033[38;5;73;48;5;237m" + done + rest + "\033[0m";
}

std::string time_note(const ProgressState& state) {
    constexpr double kEnoughSeconds = 1.0, kEnoughWork = 0.05;
    const bool foreseeable = state.elapsed >= kEnoughSeconds && state.fraction >= kEnoughWork;
    const double to_here = state.elapsed - state.still;
    const double left =
        to_here * (1.0 - state.fraction) / std::max(state.fraction, 1e-9) - state.still;
    if (foreseeable && left > 0) return readable_seconds(std::max(1.0, std::ceil(left))) + " left";
    return readable_seconds(std::floor(state.elapsed * 10) / 10);
}

std::string progress_line(const ProgressState& state, const TextStyle& style, unsigned columns) {
    const std::string stage = padded(state.stage, kStageColumns);
    const std::string note = time_note(state);
    const std::string share = percent(state.fraction);
    // "  stage bar  42 %  12 s left": what surrounds the bar, and the two columns of its ends.
    constexpr unsigned kLongestNote = 17;
    const unsigned around = 2 + kStageColumns + 1 + 2 + 2 + 4 + 2 + kLongestNote;
    const unsigned room = columns > around + 1 ? columns - 1 - around : 0;
    if (room >= kShortestBar)
        return "  " + stage + " " +
               progress_bar(state.fraction, std::min(room, kLongestBar), style) + "  " + share +
               "  " + style.dim(note);
    const std::string brief = state.stage + " " + share;
    return brief.size() < columns ? brief : "";
}

ProgressDisplay::ProgressDisplay(const Terminal& terminal, bool wanted) : terminal_(terminal) {
    if (wanted && terminal.interactive())
        painter_ =
            std::jthread([this](std::stop_token stop) { redraw_until_stopped(std::move(stop)); });
}

ProgressDisplay::~ProgressDisplay() {
    finish();
}

void ProgressDisplay::update(std::string_view stage, double fraction) {
    const std::scoped_lock lock(mutex_);
    state_.stage = stage;
    if (fraction > state_.fraction) grew_ = seconds_since(start_);
    state_.fraction = fraction;
}

RunContext ProgressDisplay::stage(std::string name, double from, double to, RunContext context) {
    context.progress = [this, name = std::move(name)](double fraction) { update(name, fraction); };
    return context.part(from, to);
}

void ProgressDisplay::finish() {
    painter_.request_stop();
    if (painter_.joinable()) painter_.join();
}

void ProgressDisplay::redraw_until_stopped(std::stop_token stop) {
    constexpr std::chrono::milliseconds kBlink{250}, kFrame{100};
    const auto next_frame = [&](std::chrono::milliseconds time, ProgressState& state) {
        std::unique_lock lock(mutex_);
        changed_.wait_for(lock, stop, time, [] { return false; });
        state = state_;
        state.elapsed = seconds_since(start_);
        state.still = state.elapsed - grew_;
        return !stop.stop_requested();
    };
    ProgressState state;
    bool drawn = false;
    for (auto time = kBlink; next_frame(time, state); time = kFrame) {
        // Cursor hidden while it would flicker; the rest of an older, longer line erased.
        const std::string line = progress_line(state, terminal_.style(), terminal_.columns());
        std::fprintf(stderr, "\033[?25l\r%s\033[K", line.c_str());
        drawn = true;
    }
    if (drawn) std::fputs("\r\033[K\033[?25h", stderr);
}

}  // namespace stipple::cli
