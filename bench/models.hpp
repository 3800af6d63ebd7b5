#pragma once

#include "stipple/point_cloud.hpp"
#include "surface_distance.hpp"

#include <filesystem>
#include <map>
#include <string>

namespace stipple::bench {

/// A cloud to try things on.
struct Model {
    std::string name;
    PointCloud cloud;            ///< positions only, cleaned
    TriangleMesh mesh;           ///< all points as they came; no triangles when synthetic
    std::filesystem::path file;  ///< the PLY file it was read from; empty for synthetic clouds

    bool synthetic() const noexcept { return file.empty(); }
};

/// The models by name, each loaded when it is first asked for:
///
///     igea     `igea.ply` of the models folder                             134,345 points
///     dragon   `dragon_vrip.ply` of the models folder, perhaps with `.gz`  437,645 points
///     2M       a bumpy sphere, always synthetic                          2,000,000 points
///
/// A scan that is not there is replaced by a bumpy sphere of as many points.
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

/// n points on a sphere with bumps, evenly spread with some jitter, slice by slice.
PointCloud bumpy_sphere(std::size_t n, std::uint64_t seed = 1);

/// Reads positions and triangles (`face` or `tristrips`) of an ascii or little-endian PLY file. Not
/// for foreign files: it believes what it reads. @throws std::runtime_error for what it does not
/// know.
TriangleMesh read_triangles(const std::filesystem::path& file);

}  // namespace stipple::bench
