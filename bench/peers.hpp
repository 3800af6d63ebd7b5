#pragma once

#include "models.hpp"
#include "stipple/neighbors.hpp"
#include "stipple/point_cloud.hpp"
#include "surface_distance.hpp"

#include <any>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

namespace stipple::bench {

/// One function of another tool, called as its manual shows. Peers are optional: of a tool that was
/// not there at configure time there are none.
struct Peer {
    std::string name;                ///< `CGAL hierarchy`
    std::function<std::any()> load;  ///< the cloud in the tool's own
                                     ///< type; outside the clock
    std::function<std::any(std::any& loaded, unsigned threads)> run;  ///< timed
    std::function<PointCloud(const std::any& loaded, const std::any& value)> points =
        {};  ///< what a simplifier keeps
};

/// Who brings the cloud of `model` down to `target` points. Parameters of those who take no count
/// are searched at the first `load`, for the count nearest to it. `model` must outlive them.
std::vector<Peer> simplifying_peers(const Model& model, std::size_t target);

/// Who estimates normals, and variation where it does, from k neighbours.
std::vector<Peer> analyzing_peers(const Model& model, unsigned k);

/// Who orients given normals over a minimum spanning tree of k neighbours; they do it on a copy.
std::vector<Peer> orienting_peers(const Model& model, const std::vector<Vec3f>& normals,
                                  unsigned k);

/// The k nearest neighbours of every point by one nanoflann tree, the queries spread over
/// `threads`, written into the same flat lists as stipple's.
NeighborLists nanoflann_nearest_neighbors(std::span<const Vec3f> points, unsigned k,
                                          unsigned threads);

/// Who reads a PLY file of points.
std::vector<Peer> reading_peers(const std::filesystem::path& file);

/// The distance of a place to the nearest triangle (CGAL's AABB tree); null without CGAL.
std::function<double(const Vec3d&)> distance_to(const TriangleMesh& mesh);

/// `CGAL, PCL`: the tools that were there, or `none`.
std::string tools_present();

/// The parameter for which `count` comes nearest to `target`; the count falls, perhaps in steps, as
/// the parameter grows. @param guess  > 0. @param whole  whether only whole numbers will do.
double tuned(const std::function<std::size_t(double)>& count, std::size_t target, double guess,
             bool whole = false);

}  // namespace stipple::bench
