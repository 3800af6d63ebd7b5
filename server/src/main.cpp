// stippled: the service. What it does is in serve.cpp; what it can be told is in config.hpp.

#include "healthcheck.hpp"
#include "scrub.hpp"
#include "serve.hpp"

#include <spdlog/spdlog.h>
#include <exception>
#include <iostream>

int main(int argc, char** argv) {
    using namespace stipple::server;
    constexpr int kRuntimeFailure = 1, kUsageFailure = 2;
    int failure = kUsageFailure;
    try {
        const auto command = parse_command_line(argc, argv);
        if (!command) return 0;
        failure = kRuntimeFailure;
        switch (command->kind) {
            case Command::Kind::Serve:
                return serve(command->config);
            case Command::Kind::Healthcheck:
                return healthcheck(command->config);
            case Command::Kind::Scrub:
                return scrub(command->config);
        }
    } catch (const std::exception& error) {
        std::cerr << "stippled: " << error.what() << '\n';
    }
    return failure;
}
