#pragma once

#include "contest.hpp"
#include "models.hpp"
#include "peers.hpp"
#include "stipple/run_context.hpp"
#include "stipple/simplify.hpp"
#include "surface_distance.hpp"

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace stipple::bench {

/// What the command line asked for.
struct BenchOptions {
    std::string filter;                    ///< a case runs when its name holds this
    std::vector<std::string> contestants;  ///< and of it those whose names hold one of these
    std::vector<std::string> scans;        ///< files to compare on; none: the cases of the list
    std::vector<std::size_t> points;       ///< of results for them; none: a hundredth of each
    unsigned repeat = 5;                   ///< timed rounds after the warm-up
    std::vector<unsigned> threads = {1, 2};
    double patience_s = 20;  ///< a contestant that has run for so long sits out the other rounds
    std::size_t samples = 100'000;  ///< of the error measure; 0: no error
    std::filesystem::path models;   ///< folder with the scans
    std::filesystem::path json;     ///< where to write the results, or empty
};

/// What one case found with one number of threads.
struct CaseResult {
    std::string name;
    unsigned threads = 1;
    std::string work;       ///< `igea: 134,345 points -> 5,000`
    std::size_t units = 0;  ///< points (or bytes) of work, for the rate
    std::vector<Standing> standings = {};
};

/// What the cases share: models, the meters of error, and what was measured so far.
class Session {
public:
    explicit Session(BenchOptions options)
        : options_(std::move(options)), models_(options_.models) {}

    const BenchOptions& options() const { return options_; }
    Models& models() { return models_; }
    const std::vector<CaseResult>& results() const { return results_; }

    /// Holds the contest among those contestants that the options let in, and prints it.
    void contest(CaseResult head, std::vector<Contestant> contestants);

    /// Whether a contestant of that name takes part: what it needs can be left out when not.
    bool invited(const std::string& contestant) const;

    /// The error of `simplified` against the model, as figures times 10^4; measured once for equal
    /// clouds.
    std::vector<Figure> error_figures(const Model& model, const PointCloud& simplified);

private:
    const SurfaceMeter& meter(const Model& model);

    BenchOptions options_;
    Models models_;
    std::vector<CaseResult> results_;
    std::map<std::string, std::unique_ptr<SurfaceMeter>> meters_;
    std::map<std::string, SurfaceDistance> errors_;  // by model and hash of the simplified cloud
};

/// A peer as one who can enter a contest. Its figures are left to the case.
Contestant contestant(const Peer& peer, unsigned threads);
/// `igea: 134,345 points`.
std::string described(const Model& model);
RunContext on_threads(unsigned threads);
bool holds_any(const std::string& name, const std::vector<std::string>& parts);

// The cases: what each compares is said in the list of all_cases.cpp.

void read_ply(Session& session, const std::string& name, const std::string& model, bool ascii);
void neighbors(Session& session, const std::string& name, const std::string& model, unsigned k);
void outliers(Session& session, const std::string& name, const std::string& model);
void pyramid(Session& session, const std::string& name, const std::string& model);
void tiles(Session& session, const std::string& name, const std::string& model);
void encode(Session& session, const std::string& name, const std::string& model);

void local_analysis(Session& session, const std::string& name, const std::string& model,
                    unsigned k);
void orientation(Session& session, const std::string& name, const std::string& model, unsigned k);

/// A way of our own to simplify.
struct Way {
    std::string name;
    SimplifyOptions options;
};
/// `stipple multiphase`.
Way plain(Method method);

/// Our ways against those of `simplifying_peers` whose names hold one of `peers`.
void simplification(Session& session, const std::string& name, const std::string& model,
                    std::size_t target, const std::vector<Way>& ways,
                    const std::vector<std::string>& peers);

/// A case by its name.
struct Case {
    std::string name;
    std::string what;
    std::function<void(Session&, const std::string& name)> run;
};
const std::vector<Case>& all_cases();
/// For scans of one's own: all methods against all peers.
std::vector<Case> scan_cases(const BenchOptions& options);

}  // namespace stipple::bench
