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

namespace {

using namespace stipple::cli;

constexpr int kRuntimeFailure = 1, kUsageFailure = 2, kSignalBase = 128;

/// One line, whatever a file may have smuggled into the message.
int fail(const Terminal& terminal, const std::string& message, int exit_code) {
    std::cerr << terminal.style().bad("stipple:") << ' ' << printable(message) << '\n';
    return exit_code;
}

}  // namespace

int main(int argc, char** argv) {
    stipple::prefer_huge_heap();
    // A server or a reader that closes early, and a limit on the size of files, are errors like
    // others.
    std::signal(SIGPIPE, SIG_IGN);
    std::signal(SIGXFSZ, SIG_IGN);
    const InterruptWatch interrupt;
    const Session session{Terminal(), interrupt.token()};
    try {
        const Command command = parse_command_line({argv + 1, argv + argc});
        std::visit([&](const auto& c) { run(c, session); }, command);
        return 0;
    } catch (const UsageError& error) {
        return fail(session.terminal, error.what(), kUsageFailure);
    } catch (const PartlyPut& stopped) {
        return fail(session.terminal, stopped.what(), kSignalBase + interrupt.signal());
    } catch (const stipple::Cancelled&) {
        return fail(session.terminal, "stopped; nothing was written",
                    kSignalBase + interrupt.signal());
    } catch (const std::exception& error) {
        return fail(session.terminal, naming_method_option(error.what()), kRuntimeFailure);
    }
}
