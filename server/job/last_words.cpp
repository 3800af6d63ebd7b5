#include "last_words.hpp"

#include "stipple/proto/run_job.hpp"

#include <pthread.h>
#include <unistd.h>
#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <exception>
#include <new>
#include <stdexcept>
#include <string>
#include <system_error>
#include <variant>

namespace stipple::job {

namespace {

using proto::kJobStages;
using proto::Problem;

/// One line for each stage, and one for the time before the first.
using Lines = std::array<std::string, kJobStages.size() + 1>;

struct LastWords {
    Lines out_of_memory, out_of_time, lost;
};

// What a signal handler reads cannot be handed to it: these live as long as the process and are
// written once.
const LastWords* last_words = nullptr;
std::atomic<std::size_t> stage_number = 0;  // 0: before the first stage
std::atomic_flag writing;

static_assert(std::atomic<std::size_t>::is_always_lock_free);

std::string_view stage_name(std::size_t number) noexcept {
    return number == 0 ? std::string_view() : kJobStages[number - 1];
}

Lines lines(ErrorCode code, const std::string& detail) {
    Lines result;
    for (std::size_t number = 0; number < result.size(); ++number) {
        Problem problem = proto::problem_from(code, detail);
        if (number != 0) problem.stage = std::string(stage_name(number));
        result[number] = to_json(proto::JobReport(problem)) + '\n';
    }
    return result;
}

void write_all(std::string_view text) noexcept {
    while (!text.empty()) {
        const ssize_t n = ::write(STDOUT_FILENO, text.data(), text.size());
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) return;  // nobody listens any more
        text.remove_prefix(static_cast<std::size_t>(n));
    }
}

/// Takes the output for good: nothing is written after the last words. Safe in a signal handler,
/// because `write_report` blocks the signals of its thread while it holds the flag.
[[noreturn]] void say(const Lines& words) noexcept {
    while (writing.test_and_set(std::memory_order_acquire)) {
    }
    write_all(words[stage_number.load()]);
    ::_exit(0);
}

extern "C" void on_cpu_limit(int) {
    say(last_words->out_of_time);
}

/// Draco and TBB have functions that must not throw: a failed allocation inside one ends here.
[[noreturn]] void on_terminate() {
    try {
        if (const auto exception = std::current_exception()) std::rethrow_exception(exception);
    } catch (const std::exception& error) {
        say(is_out_of_memory(error) ? last_words->out_of_memory : last_words->lost);
    } catch (...) {
        say(last_words->lost);
    }
    say(last_words->lost);
}

}  // namespace

bool is_out_of_memory(const std::exception& error) noexcept {
    if (dynamic_cast<const std::bad_alloc*>(&error) != nullptr ||
        dynamic_cast<const std::length_error*>(&error) != nullptr)
        return true;
    if (const auto* const system = dynamic_cast<const std::system_error*>(&error))
        return system->code() == std::errc::resource_unavailable_try_again ||
               system->code() == std::errc::not_enough_memory;
    // TBB's own words when a thread finds no room for its stack.
    return std::strstr(error.what(), "pthread_create") != nullptr;
}

void prepare_last_words(const proto::JobSpec& spec) {
    static const LastWords words{
        lines(ErrorCode::TooLarge, proto::memory_limit_message(spec)),
        lines(ErrorCode::TooLarge,
              "the job needs more than its limit of " + std::to_string(spec.max_cpu_seconds) +
                  " seconds of processor time: upload a smaller cloud, or raise the limit"),
        lines(ErrorCode::Internal, "the job ended with an uncaught exception")};
    last_words = &words;
    std::set_terminate(on_terminate);

    struct sigaction action = {};
    action.sa_handler = on_cpu_limit;
    ::sigfillset(&action.sa_mask);
    ::sigaction(SIGXCPU, &action, nullptr);
}

void write_report(const proto::JobReport& report) {
    const std::string line = to_json(report) + '\n';
    if (const auto* const progress = std::get_if<proto::JobProgress>(&report)) {
        const auto* stage = std::ranges::find(kJobStages, progress->stage);
        stage_number = static_cast<std::size_t>(stage - kJobStages.begin()) + 1;
    }
    sigset_t cpu_limit, before;
    ::sigemptyset(&cpu_limit);
    ::sigaddset(&cpu_limit, SIGXCPU);
    ::pthread_sigmask(SIG_BLOCK, &cpu_limit, &before);
    while (writing.test_and_set(std::memory_order_acquire)) {
    }
    write_all(line);
    writing.clear(std::memory_order_release);
    ::pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

std::string_view current_stage() noexcept {
    return stage_name(stage_number.load());
}

}  // namespace stipple::job
