// stipple-bench: every comparison that bench/README.md reports, in the manner of leveldb's
// db_bench.

#include "cases.hpp"
#include "peers.hpp"
#include "program.hpp"
#include "report.hpp"

#include <fstream>
#include <iostream>
#include <stdexcept>
#include <string>
#include <vector>

namespace stipple::bench {

namespace {

/// Whether none took more memory than it says; says which did.
bool all_keep_to_stated_memory(const std::vector<CaseResult>& results) {
    bool kept = true;
    for (const CaseResult& result : results) {
        for (const Standing& standing : result.standings) {
            if (!standing.is_above_stated()) continue;
            kept = false;
            std::cerr << "stipple-bench: " << result.name << ": " << standing.name << " took "
                      << standing.peak_bytes() / 1'000'000 << " MB, above the "
                      << standing.stated_bytes / 1'000'000 << " MB that its header states\n";
        }
    }
    return kept;
}

/// @return whether every contestant kept to the memory that it states.
bool run_cases(const BenchOptions& options) {
    std::cout << "Medians of " << options.repeat << " rounds after a warm-up, contestants in turn. "
              << "Ratios: times the first row's time.\n"
              << "Compared with: " << tools_present() << ".\n";
    Session session(options);
    for (const Case& c : options.scans.empty() ? all_cases() : scan_cases(options))
        if (c.name.find(options.filter) != std::string::npos) c.run(session, c.name);
    if (!options.json.empty()) {
        std::ofstream out(options.json);
        write_json(out, session.results());
        if (!out.flush()) throw std::runtime_error("cannot write " + options.json.string());
    }
    return all_keep_to_stated_memory(session.results());
}

}  // namespace

}  // namespace stipple::bench

int main(int argc, char** argv) {
    using namespace stipple::bench;
    BenchOptions options;
    bool list = false;
    CLI::App app("Every comparison that bench/README.md reports.", "stipple-bench");
    app.add_flag("--list", list, "print the cases and stop");
    app.add_option("--filter", options.filter, "only cases whose name holds TEXT")
        ->type_name("TEXT");
    app.add_option("--contestants", options.contestants,
                   "and of them only contestants whose name holds one of TEXT,...")
        ->type_name("TEXT")
        ->delimiter(',')
        ->allow_extra_args(false);
    app.add_option("--scan", options.scans,
                   "PLY files of yours: all methods and peers for each, instead of the cases")
        ->type_name("FILE")
        ->check(CLI::ExistingFile)
        ->delimiter(',')
        ->allow_extra_args(false);
    app.add_option("--points", options.points,
                   "of the results for those; a hundredth of each scan when not given")
        ->delimiter(',')
        ->allow_extra_args(false)
        ->check(at_least(1));
    app.add_option("--repeat", options.repeat, "timed rounds after a warm-up")
        ->check(at_least(1))
        ->capture_default_str();
    app.add_option("--patience", options.patience_s,
                   "seconds; who has run for so long sits out the other rounds")
        ->check(at_least(0))
        ->capture_default_str();
    app.add_option("--threads", options.threads, "numbers of threads to try")
        ->delimiter(',')
        ->allow_extra_args(false)
        ->check(at_least(1))
        ->capture_default_str();
    app.add_option("--samples", options.samples, "places where the error is measured; 0: no error")
        ->check(at_least(0))
        ->capture_default_str();
    app.add_option("--models", options.models,
                   "folder with igea.ply and dragon_vrip.ply[.gz]; else bumpy spheres of their "
                   "sizes")
        ->type_name("DIR");
    app.add_option("--json", options.json, "write every run to this file")->type_name("FILE");
    return run_program(app, argc, argv, [&] {
        if (!list) return run_cases(options) ? 0 : 1;
        for (const Case& c : all_cases()) std::cout << c.name << "  " << c.what << '\n';
        return 0;
    });
}
