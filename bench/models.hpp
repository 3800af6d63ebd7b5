#pragma once

#include "stipple/point_cloud.hpp"
#include "surface_distance.hpp"

#include <filesystem>
#include <functional>
#include <map>
#include <string>

namespace stipple::bench {

/// A cloud to try things on.
struct Model {
    std::string name;
    PointCloud cloud;   ///< positions only, cleaned
    TriangleMesh mesh;  ///< the true surface: that of the file, or of the formula
    std::function<Vec3d(const Vec3d&)> foot = {};  ///< the formula's nearest point; null for scans
    std::filesystem::path file;  ///< the PLY file it was read from; empty for synthetic clouds

    bool synthetic() const noexcept { return file.empty(); }
};

/// The models by name, each loaded when it is first asked for:
///
///     igea     `igea.ply` of the models folder                             134,345 points
///     dragon   `dragon_vrip.ply` of the models folder, perhaps with `.gz`  437,645 points
///     2M       a bumpy sphere, always synthetic; also 1M, 10M, 250k...   2,000,000 points
///     a path   of any PLY file that `read_triangles` knows, perhaps with `.gz`
///
/// The igea or the dragon, if not there, is replaced by a bumpy sphere of as many points. A file of
/// a path is moved so that its first point is the origin: others may be too far off for floats.
class Models {
public:
    /// @param folder  where the scans are, or empty.
    explicit Models(std::filesystem::path folder);
    ~Models();
    Models(const Models&) = delete;
    Models& operator=(const Models&) = delete;

    const Model& get(const std::string& name);

    /// The model as a file of that encoding, with its triangles: its own file where that is one,
    /// else written.
    std::filesystem::path ply_file(const std::string& name, bool ascii);

private:
    Model load(const std::string& name);

    std::filesystem::path folder_;
    std::filesystem::path temporary_;
    std::map<std::string, Model> models_;
};

// A closed surface given by a formula, with hills and dales of many sizes: the unit sphere with the
// radius 1 + 0.08 sin(9x) sin(7y + 1) sin(8z + 2) + 0.01 sin(31x + 2) sin(37y) sin(29z + 1) in the
// direction (x, y, z).

/// n points on it, evenly spread with some jitter, slice by slice.
PointCloud bumpy_sphere(std::size_t n, std::uint64_t seed = 1);
/// Triangles between 6 * n * n places of it.
TriangleMesh bumpy_sphere_mesh(unsigned n);
/// Its point nearest to q, to 1e-9, for q nearer to it than its least radius of curvature.
Vec3d bumpy_sphere_foot(const Vec3d& q);

/// Reads positions and triangles (`face` or `tristrips`) of an ascii or little-endian PLY file. Not
/// for foreign files: it believes what it reads. @throws std::runtime_error for what it does not
/// know.
TriangleMesh read_triangles(const std::filesystem::path& file);

}  // namespace stipple::bench
