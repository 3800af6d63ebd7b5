// stipple-bench: every comparison that bench/README.md reports, in the manner of leveldb's
// db_bench.

#include "cases.hpp"
#include "peers.hpp"
#include "report.hpp"

#include <fstream>
#include <iostream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace stipple::bench {

namespace {

constexpr const char* kUsage = R"(stipple-bench [options]
  --list                print the cases and stop
  --filter TEXT         only cases whose name holds TEXT
  --contestants TEXT    and of them only contestants whose name holds TEXT
  --repeat N            timed rounds after a warm-up (5)
  --patience SECONDS    who has run for so long sits out the other rounds (20)
  --threads A,B,...     numbers of threads to try (1,2)
  --samples N           places where the error is measured (100000; 0: no error)
  --models DIR          folder with igea.ply and dragon_vrip.ply[.gz]; else bumpy spheres of
                        their sizes
  --json FILE           write every run to FILE
)";

unsigned long number(const std::string& option, const std::string& text) {
    std::size_t used = 0;
    const unsigned long value = std::stoul(text, &used);
    if (used != text.size())
        throw std::invalid_argument(option + " " + text + ": expected a number");
    return value;
}

std::vector<unsigned> thread_counts(const std::string& text) {
    std::vector<unsigned> counts;
    std::istringstream parts(text);
    for (std::string part; std::getline(parts, part, ',');)
        counts.push_back(static_cast<unsigned>(number("--threads", part)));
    if (counts.empty() || std::ranges::count(counts, 0U) > 0)
        throw std::invalid_argument("--threads " + text + ": expected numbers of 1 or more");
    return counts;
}

BenchOptions parse(const std::vector<std::string>& arguments, bool& list) {
    BenchOptions options;
    for (std::size_t i = 0; i < arguments.size(); ++i) {
        const std::string& option = arguments[i];
        if (option == "--list") {
            list = true;
            continue;
        }
        if (i + 1 == arguments.size()) throw std::invalid_argument(option + ": a value is missing");
        const std::string& value = arguments[++i];
        if (option == "--filter")
            options.filter = value;
        else if (option == "--contestants")
            options.contestants = value;
        else if (option == "--repeat")
            options.repeat = static_cast<unsigned>(number(option, value));
        else if (option == "--patience")
            options.patience_s = static_cast<double>(number(option, value));
        else if (option == "--threads")
            options.threads = thread_counts(value);
        else if (option == "--samples")
            options.samples = number(option, value);
        else if (option == "--models")
            options.models = value;
        else if (option == "--json")
            options.json = value;
        else
            throw std::invalid_argument(option + ": unknown");
    }
    if (options.repeat == 0) throw std::invalid_argument("--repeat 0: expected 1 or more");
    return options;
}

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
    for (const Case& c : all_cases())
        if (c.name.find(options.filter) != std::string::npos) c.run(session, c.name);
    if (!options.json.empty()) {
        std::ofstream out(options.json);
        write_json(out, session.results());
        if (!out.flush()) throw std::runtime_error("cannot write " + options.json.string());
    }
    return all_keep_to_stated_memory(session.results());
}

int run(const std::vector<std::string>& arguments) {
    try {
        bool list = false;
        const BenchOptions options = parse(arguments, list);
        if (list)
            for (const Case& c : all_cases()) std::cout << c.name << "  " << c.what << '\n';
        else
            return run_cases(options) ? 0 : 1;
        return 0;
    } catch (const std::invalid_argument& error) {
        std::cerr << "stipple-bench: " << error.what() << '\n' << kUsage;
        return 2;
    } catch (const std::exception& error) {
        std::cerr << "stipple-bench: " << error.what() << '\n';
        return 1;
    }
}

}  // namespace

}  // namespace stipple::bench

int main(int argc, char** argv) {
    return stipple::bench::run({argv + 1, argv + argc});
}
