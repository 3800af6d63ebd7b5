#pragma once

#include "stipple/point_cloud.hpp"

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

namespace stipple::test {

/// A file of `tests/data`.
std::filesystem::path data_file(std::string_view name);

/// A real scan from the shared test data (`models/igea.ply`; a `.gz` is unpacked into the temporary
/// folder), or nothing where that data is not: skip the test with a message then.
std::optional<std::filesystem::path> shared_file(std::string_view name);
/// The folder of the shared test data, when it is there.
std::optional<std::filesystem::path> shared_folder(std::string_view name);

/// Whether this is a sanitizer's build, which knows no limit of memory and no filter of system
/// calls.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr bool kSanitized = true;
#else
inline constexpr bool kSanitized = false;
#endif

/// A program that was built: `stippled`.
std::filesystem::path program(std::string_view name);

/// A folder that is removed with all in it at the end.
class TemporaryFolder {
public:
    TemporaryFolder();
    ~TemporaryFolder();
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;
    const std::filesystem::path& path() const noexcept { return path_; }
    std::filesystem::path operator/(std::string_view name) const { return path_ / name; }

private:
    std::filesystem::path path_;
};

/// n points on the unit sphere, evenly spread (Fibonacci), moved along the normal by up to `noise`.
PointCloud sphere(std::size_t n, double noise = 0.0, std::uint64_t seed = 1);
/// n points at random in the unit square of the plane z = 0.
PointCloud plane(std::size_t n, std::uint64_t seed = 1);
/// n points at random on both sides of a wall, the squares [0, 1]^2 at z = 0 and at z = `gap`;
/// those of the former are red, the others blue.
PointCloud wall(std::size_t n, float gap, std::uint64_t seed = 1);
/// n points on a line.
PointCloud line(std::size_t n);
/// n points at random in the unit cube.
PointCloud cube(std::size_t n, std::uint64_t seed = 1);
/// `cloud` with normals, colours, a float and a label attribute, each a known function of the
/// position.
PointCloud with_attributes(PointCloud cloud);

}  // namespace stipple::test
