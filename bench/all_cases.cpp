// A case is named method/shape/target. Its contestants run in turn in this process; where a peer
// was not found when the program was configured, the case runs without it.

#include "cases.hpp"

namespace stipple::bench {

namespace {

using S = Session;
using N = const std::string;

Case method_case(Method method, const std::string& model, std::size_t target,
                 const std::vector<std::string>& peers, const std::vector<Way>& beside = {}) {
    std::vector<Way> ways = {plain(method)};
    ways.insert(ways.end(), beside.begin(), beside.end());
    return {std::string(to_string(method)) + '/' + model + '/' + std::to_string(target),
            "against " + (peers.empty() ? "our own" : peers.front()),
            [=](S& s, N& name) { simplification(s, name, model, target, ways, peers); }};
}

Way with_representative(const std::string& name, Representative representative) {
    Way way = plain(Method::Hierarchical);
    way.name += ", " + name;
    way.options.hierarchical.representative = representative;
    return way;
}

void add_io_cases(std::vector<Case>& all) {
    all.insert(all.end(),
               {{"ply/read/igea-binary", "read_cloud against CGAL's read_PLY and the raw bytes",
                 [](S& s, N& name) { read_ply(s, name, "igea", false); }},
                {"ply/read/dragon-ascii", "the same, 437,645 points and 871,414 triangles of text",
                 [](S& s, N& name) { read_ply(s, name, "dragon", true); }},
                {"ply/read/dragon-binary", "the same in little endian",
                 [](S& s, N& name) { read_ply(s, name, "dragon", false); }},
                {"ply/read/2M-binary", "the same, points only",
                 [](S& s, N& name) { read_ply(s, name, "2M", false); }},
                {"pyramid/dragon/ratio-4", "all levels against the finest cut alone",
                 [](S& s, N& name) { pyramid(s, name, "dragon"); }},
                {"pyramid/2M/ratio-4", "the same of a scan of two million points",
                 [](S& s, N& name) { pyramid(s, name, "2M"); }},
                {"pyramid/10M/ratio-4", "the same of ten million",
                 [](S& s, N& name) { pyramid(s, name, "10M"); }},
                {"tiles/dragon/ratio-4", "all levels with their tiles, measured and encoded",
                 [](S& s, N& name) { tiles(s, name, "dragon"); }},
                {"tiles/2M/ratio-4", "the same of a scan of two million points",
                 [](S& s, N& name) { tiles(s, name, "2M"); }},
                {"tiles/10M/ratio-4", "the same of ten million",
                 [](S& s, N& name) { tiles(s, name, "10M"); }},
                {"encode/dragon", "Draco and PLY encoding",
                 [](S& s, N& name) { encode(s, name, "dragon"); }}});
}

void add_local_cases(std::vector<Case>& all) {
    for (const std::string model : {"igea", "dragon", "2M"}) {
        all.push_back({"neighbors/k16/" + model, "against nanoflann: build and all queries",
                       [=](S& s, N& name) { neighbors(s, name, model, 16); }});
        all.push_back({"local-analysis/k16/" + model,
                       "neighbours, normals and variation against PCL, Open3D and CGAL",
                       [=](S& s, N& name) { local_analysis(s, name, model, 16); }});
        all.push_back({"outliers/" + model, "points off all surfaces, looked for in a scan",
                       [=](S& s, N& name) { outliers(s, name, model); }});
        all.push_back({"orientation/k16/" + model, "against CGAL's mst_orient_normals",
                       [=](S& s, N& name) { orientation(s, name, model, 16); }});
    }
}

void add_method_cases(std::vector<Case>& all) {
    struct Work {
        std::string model;
        std::size_t target;
    };
    const std::vector<Work> works = {{"igea", 5'000}, {"dragon", 4'376}, {"2M", 5'000}};
    const std::vector<std::string> hierarchy = {"CGAL hierarchy"};
    const std::vector<std::string> even = {"Farthest", "on the mesh"};
    for (const auto& [model, target] : works) {
        all.push_back(method_case(Method::Hierarchical, model, target,
                                  {"CGAL hierarchy", "CGAL random"},
                                  {with_representative("surface", Representative::Surface),
                                   with_representative("centroid", Representative::Centroid)}));
        all.push_back(method_case(Method::Multiphase, model, target, hierarchy));
        all.push_back(
            method_case(Method::Incremental, model, target, {}, {plain(Method::Hierarchical)}));
        all.push_back(method_case(Method::Iterative, model, target, even));
        all.push_back(method_case(Method::Particles, model, target, {"CGAL WLOP", "PoissonDisk"}));
        all.push_back(method_case(Method::Voxel, model, target,
                                  {"Voxel", "Uniform", "grid", "simplifyPoints"}));
    }
    all.push_back(method_case(Method::Iterative, "1M", 10'000, even));
    all.push_back(method_case(Method::Particles, "1M", 10'000, {"CGAL WLOP", "PoissonDisk"}));
    all.push_back(
        method_case(Method::Multiphase, "10M", 100'000, hierarchy, {plain(Method::Hierarchical)}));
}

/// All methods of ours but the random subset.
std::vector<Way> our_ways() {
    std::vector<Way> ways;
    for (const Method method : kMethods)
        if (method != Method::Random) ways.push_back(plain(method));
    return ways;
}

/// What the plots show: time and error against target, time against input, as the paper's Fig. 9.
void add_series(std::vector<Case>& all) {
    const std::vector<Way> ways = our_ways();
    const std::vector<std::string> peers = {"CGAL hierarchy"};
    for (const std::size_t target : {1'000, 2'000, 5'000, 10'000, 20'000, 50'000, 100'000})
        all.push_back(
            {"by-target/dragon/" + std::to_string(target), "all methods",
             [=](S& s, N& name) { simplification(s, name, "dragon", target, ways, peers); }});
    for (const auto& [model, points] :
         std::vector<std::pair<std::string, std::size_t>>{{"125k", 125'000},
                                                          {"250k", 250'000},
                                                          {"500k", 500'000},
                                                          {"1M", 1'000'000},
                                                          {"2M", 2'000'000},
                                                          {"4M", 4'000'000}})
        all.push_back(
            {"by-size/" + model + "/" + std::to_string(points / 100), "all methods, to 1 %",
             [=](S& s, N& name) { simplification(s, name, model, points / 100, ways, peers); }});
}

}  // namespace

const std::vector<Case>& all_cases() {
    static const std::vector<Case> cases = [] {
        std::vector<Case> all;
        add_io_cases(all);
        add_local_cases(all);
        add_method_cases(all);
        add_series(all);
        return all;
    }();
    return cases;
}

std::vector<Case> scan_cases(const BenchOptions& options) {
    std::vector<Case> cases;
    for (const std::string& scan : options.scans) {
        const auto add = [&](std::size_t points, const std::string& name) {
            cases.push_back({name, "all methods and peers", [=](S& s, N& case_name) {
                                 const std::size_t hundredth = std::max<std::size_t>(
                                     1, s.models().get(scan).cloud.size() / 100);
                                 simplification(s, case_name, scan,
                                                points == 0 ? hundredth : points, our_ways(), {""});
                             }});
        };
        const std::string name = "scan/" + std::filesystem::path(scan).stem().string();
        for (const std::size_t points : options.points)
            add(points, name + '/' + std::to_string(points));
        if (options.points.empty()) add(0, name);
    }
    return cases;
}

}  // namespace stipple::bench
