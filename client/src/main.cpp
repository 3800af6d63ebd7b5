#include "cli/bucket.hpp"
#include "cli/command_line.hpp"
#include "cli/commands.hpp"
#include "cli/interrupt.hpp"
#include "cli/method_options.hpp"
#include "cli/text.hpp"
#include "stipple/error.hpp"
#include "stipple/heap.hpp"

#include <csignal>
#include <iostream>
#include <new>
#include <system_error>

namespace {

using namespace stipple::cli;

constexpr int kRuntimeFailure = 1, kUsageFailure = 2;

/// One line, whatever a file may have smuggled into the message.
int fail(const Terminal& terminal, const std::string& message, int exit_code) {
    std::cerr << terminal.style().bad("stipple:") << ' ' << printable(message) << '\n';
    return exit_code;
}

/// @param signal  that stopped it, if one did.
int run(const std::vector<std::string>& words, int& signal) {
    const InterruptWatch interrupt;
    const Session session{Terminal(), interrupt.token()};
    const auto stopped = [&](const std::string& message) {
        signal = interrupt.signal();
        return fail(session.terminal, message, kRuntimeFailure);
    };
    try {
        const Command command = parse_command_line(words);
        std::visit([&](const auto& c) { run(c, session); }, command);
        return 0;
    } catch (const UsageError& error) {
        return fail(session.terminal, error.what(), kUsageFailure);
    } catch (const PartlyPut& partly) {
        return stopped(partly.what());
    } catch (const stipple::Cancelled&) {
        return stopped("stopped; nothing was written");
    } catch (const std::bad_alloc&) {
        return fail(session.terminal, "the memory is too small", kRuntimeFailure);
    } catch (const std::exception& error) {
        return fail(session.terminal, naming_method_option(error.what()), kRuntimeFailure);
    }
}

}  // namespace

int main(int argc, char** argv) {
    stipple::prefer_huge_heap();
    // A server or a reader that closes early, and a limit on the size of files, are errors like
    // others.
    std::signal(SIGPIPE, SIG_IGN);
    std::signal(SIGXFSZ, SIG_IGN);
    int signal = 0;
    try {
        const int exit_code = run({argv + 1, argv + argc}, signal);
        if (signal != 0) die_of(signal);  // all is tidy by now
        return exit_code;
    } catch (const std::system_error& error) {
        return fail(Terminal(), std::string("cannot start: ") + error.what(), kRuntimeFailure);
    }
}
