#pragma once

#include "cli/command_line.hpp"
#include "cli/terminal.hpp"
#include "stipple/run_context.hpp"

#include <stop_token>
#include <string>

namespace stipple::cli {

/// What a command has to do with beside its options.
struct Session {
    Terminal terminal;
    std::stop_token stop;
};

/// How what is computed here is run, progress aside.
inline RunContext context_of(const CommonOptions& common, const Session& session) {
    return {.stop = session.stop, .progress = {}, .threads = common.threads};
}

// One for each command. @throws Error with the file named, Cancelled. Nothing half done is left
// behind.
void run(const InfoCommand& command, const Session& session);
void run(const SimplifyCommand& command, const Session& session);
void run(const UpsampleCommand& command, const Session& session);
void run(const CurveCommand& command, const Session& session);
void run(const AnalyzeCommand& command, const Session& session);
void run(const PyramidCommand& command, const Session& session);
void run(const SliceCommand& command, const Session& session);
void run(const EvaluateCommand& command, const Session& session);
void run(const InspectCommand& command, const Session& session);
void run(const ConvertCommand& command, const Session& session);
void run(const SynthesizeCommand& command, const Session& session);

}  // namespace stipple::cli
