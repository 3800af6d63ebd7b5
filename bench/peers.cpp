#include "peers.hpp"

#include "peer_tools.hpp"

#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

namespace stipple::bench {

namespace {

[[maybe_unused]] void append(std::vector<Peer>& all, std::vector<Peer> more) {
    all.insert(all.end(), std::make_move_iterator(more.begin()),
               std::make_move_iterator(more.end()));
}

}  // namespace

std::vector<Peer> simplifying_peers([[maybe_unused]] const Model& model,
                                    [[maybe_unused]] std::size_t target) {
    std::vector<Peer> all;
#ifdef STIPPLE_WITH_CGAL
    append(all, cgal::simplifiers(model, target));
#endif
#ifdef STIPPLE_WITH_PCL
    append(all, pcl_peer::simplifiers(model, target));
#endif
#ifdef STIPPLE_WITH_OPEN3D
    append(all, open3d_peer::simplifiers(model, target));
#endif
#ifdef STIPPLE_WITH_MESHOPTIMIZER
    append(all, meshopt_peer::simplifiers(model, target));
#endif
    return all;
}

std::vector<Peer> analyzing_peers([[maybe_unused]] const Model& model,
                                  [[maybe_unused]] unsigned k) {
    std::vector<Peer> all;
#ifdef STIPPLE_WITH_PCL
    append(all, pcl_peer::analyzers(model, k));
#endif
#ifdef STIPPLE_WITH_OPEN3D
    append(all, open3d_peer::analyzers(model, k));
#endif
#ifdef STIPPLE_WITH_CGAL
    append(all, cgal::analyzers(model, k));
#endif
    return all;
}

std::vector<Peer> orienting_peers([[maybe_unused]] const Model& model,
                                  [[maybe_unused]] const std::vector<Vec3f>& normals,
                                  [[maybe_unused]] unsigned k) {
#ifdef STIPPLE_WITH_CGAL
    return cgal::orienters(model, normals, k);
#else
    return {};
#endif
}

std::vector<Peer> reading_peers([[maybe_unused]] const std::filesystem::path& file) {
#ifdef STIPPLE_WITH_CGAL
    return cgal::readers(file);
#else
    return {};
#endif
}

std::function<double(const Vec3d&)> distance_to([[maybe_unused]] const TriangleMesh& mesh) {
#ifdef STIPPLE_WITH_CGAL
    return cgal::distance_to(mesh);
#else
    return {};
#endif
}

std::string tools_present() {
    std::string names;
#ifdef STIPPLE_WITH_CGAL
    names += "CGAL, ";
#endif
#ifdef STIPPLE_WITH_PCL
    names += "PCL, ";
#endif
#ifdef STIPPLE_WITH_OPEN3D
    names += "Open3D, ";
#endif
#ifdef STIPPLE_WITH_MESHOPTIMIZER
    names += "meshoptimizer, ";
#endif
    return names + "nanoflann";
}

double tuned(const std::function<std::size_t(double)>& count, std::size_t target, double guess,
             bool whole) {
    // A count is nearly a power of its parameter: secants of the logarithms, kept between a
    // parameter known to give too many and one known to give too few.
    constexpr int kMaxSteps = 16;
    double low = 0, high = std::numeric_limits<double>::infinity();
    double best = guess, best_miss = std::numeric_limits<double>::infinity();
    double x = guess, power = whole ? -1 : -2;
    std::pair<double, double> previous(0, 0);  // logarithms of parameter and count / target
    for (int step = 0; step < kMaxSteps; ++step) {
        if (whole) x = std::max(1.0, std::round(x));
        const double ratio = static_cast<double>(count(x)) / static_cast<double>(target);
        const double miss = std::abs(ratio - 1);
        if (miss < best_miss) {
            best = x;
            best_miss = miss;
        }
        if (miss == 0) break;
        (ratio > 1 ? low : high) = x;
        const std::pair<double, double> here(std::log(x), std::log(std::max(ratio, 1e-9)));
        if (step > 0 && here.first != previous.first) {
            const double slope = (here.second - previous.second) / (here.first - previous.first);
            if (slope < -0.2 && slope > -10) power = slope;
        }
        previous = here;
        x = std::exp(here.first - here.second / power);
        if (!(x > low && x < high))
            x = low == 0 ? high / 2 : std::isinf(high) ? 2 * low : 0.5 * (low + high);
        if (whole && high - low <= 1) break;
        if (whole) x = std::clamp(std::round(x), low + 1, std::max(low + 1, high - 1));
    }
    return best;
}

}  // namespace stipple::bench
