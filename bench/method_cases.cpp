// Contests of the paper's §2 and §3 against others who do the same.

#include "cases.hpp"
#include "stipple/local_analysis.hpp"
#include "stipple/normal_orientation.hpp"
#include "stipple/proto/thousands.hpp"

#include <algorithm>
#include <any>
#include <memory>

namespace stipple::bench {

namespace {

/// What the method's header says it needs beyond the clouds, for bare positions, with 8 MB on each
/// thread; and the result, and some pages that any program has at hand.
std::size_t stated_bytes(const SimplifyOptions& options, std::size_t points, std::size_t target,
                         unsigned threads) {
    const auto n = static_cast<double>(points), kept = static_cast<double>(target);
    const auto bytes = [&] {
        switch (options.method) {
            case Method::Multiphase:
                return std::max(8 * n, 4 * n + 250 * options.oversampling * kept +
                                           2200 * std::min(kept, 12'000.0));
            case Method::Hierarchical:
                return std::max(8 * n, 4 * n + 120 * kept);
            case Method::Incremental:
                return 50 * n + 200 * kept;
            case Method::Iterative:
                return std::max((72 + 4 * options.iterative.k) * n + 300 * std::min(n, 8 * kept),
                                std::min(4300 * kept, 30e6));
            case Method::Particles:
                return 60 * n + 160 * std::min(n, 16 * kept) + 250 * kept;
            case Method::Voxel:
                return 8 * n + 40 * kept;
            case Method::Random:
                break;
        }
        return 4 * kept;
    };
    constexpr double kOfThread = 8 * 1'048'576, kAtHand = 4e6;
    return static_cast<std::size_t>(bytes() + kOfThread * threads + sizeof(Vec3f) * kept + kAtHand);
}

Contestant contestant(Session& session, const Model& model, const Way& way, std::size_t target,
                      unsigned threads) {
    SimplifyOptions options = way.options;
    options.points = target;
    return {.name = way.name,
            .run = [=, &model]() -> std::any {
                return simplify(model.cloud, options, on_threads(threads));
            },
            .figures =
                [&](const std::any& value) {
                    return session.error_figures(model, std::any_cast<const PointCloud&>(value));
                },
            .stated_bytes = stated_bytes(options, model.cloud.size(), target, threads)};
}

Contestant simplifier(Session& session, const Model& model, const Peer& peer, unsigned threads) {
    // What is left can lie in what was loaded, so both are kept until the figures are known.
    const auto loaded = std::make_shared<std::any>();
    return {.name = peer.name,
            .run = [=, run = peer.run] { return run(*loaded, threads); },
            .prepare = [=, load = peer.load] { *loaded = load(); },
            .figures =
                [=, &session, &model, points = peer.points](const std::any& value) {
                    return session.error_figures(model, points(*loaded, value));
                },
            .release = [=] { loaded->reset(); }};
}

}  // namespace

Way plain(Method method) {
    return {"stipple " + std::string(to_string(method)), {.method = method}};
}

void local_analysis(Session& session, const std::string& name, const std::string& model_name,
                    unsigned k) {
    const Model& model = session.models().get(model_name);
    const std::vector<Peer> peers = analyzing_peers(model, k);
    for (const unsigned threads : session.options().threads) {
        std::vector<Contestant> contestants = {
            {.name = "stipple analyze_locally", .run = [=, &model]() -> std::any {
                 return analyze_locally(model.cloud.positions, {.k = k}, on_threads(threads));
             }}};
        for (const Peer& peer : peers) contestants.push_back(bench::contestant(peer, threads));
        session.contest({.name = name,
                         .threads = threads,
                         .work = described(model) + ", k = " + std::to_string(k) +
                                 ": neighbours, normals and, of stipple and PCL, variation",
                         .units = model.cloud.size()},
                        std::move(contestants));
    }
}

void orientation(Session& session, const std::string& name, const std::string& model_name,
                 unsigned k) {
    const Model& model = session.models().get(model_name);
    const std::vector<Vec3f>& points = model.cloud.positions;
    const std::vector<Vec3f> normals =
        analyze_locally(points, {.k = k, .variation = false}).normals;
    const std::vector<Peer> peers = orienting_peers(model, normals, k);
    for (const unsigned threads : session.options().threads) {
        const auto oriented = std::make_shared<std::vector<Vec3f>>();
        std::vector<Contestant> contestants = {{.name = "stipple orient_normals",
                                                .run = [=, &points]() -> std::any {
                                                    orient_normals(points, *oriented, {.k = k},
                                                                   on_threads(threads));
                                                    return {};
                                                },
                                                .prepare = [=, &normals] { *oriented = normals; }}};
        for (const Peer& peer : peers) contestants.push_back(bench::contestant(peer, threads));
        session.contest({.name = name,
                         .threads = threads,
                         .work = described(model) + ", k = " + std::to_string(k) +
                                 ", normals given; CGAL uses one thread",
                         .units = points.size()},
                        std::move(contestants));
    }
}

void simplification(Session& session, const std::string& name, const std::string& model_name,
                    std::size_t target, const std::vector<Way>& ways,
                    const std::vector<std::string>& peers) {
    const Model& model = session.models().get(model_name);
    std::vector<Peer> invited = simplifying_peers(model, target);
    std::erase_if(invited, [&](const Peer& peer) { return !holds_any(peer.name, peers); });
    for (const unsigned threads : session.options().threads) {
        std::vector<Contestant> contestants;
        for (const Way& way : ways)
            contestants.push_back(contestant(session, model, way, target, threads));
        for (const Peer& peer : invited)
            contestants.push_back(simplifier(session, model, peer, threads));
        session.contest({.name = name,
                         .threads = threads,
                         .work = described(model) + " -> " + proto::with_separators(target) +
                                 "; distances are 10^-4 of the diagonal",
                         .units = model.cloud.size()},
                        std::move(contestants));
    }
}

}  // namespace stipple::bench
