#include "support/support.hpp"

#include <unistd.h>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <random>
#include <stdexcept>

namespace stipple::test {

namespace fs = std::filesystem;

fs::path data_file(std::string_view name) {
    return fs::path(STIPPLE_TEST_DATA) / name;
}

std::optional<fs::path> shared_folder(std::string_view name) {
    const fs::path folder = fs::path(STIPPLE_SHARED_DATA) / name;
    return fs::is_directory(folder) ? std::optional(folder) : std::nullopt;
}

std::optional<fs::path> shared_file(std::string_view name) {
    const fs::path file = fs::path(STIPPLE_SHARED_DATA) / name;
    if (fs::exists(file)) return file;
    const fs::path packed = file.string() + ".gz";
    if (!fs::exists(packed)) return std::nullopt;

    // Unpacked once, under the name of the file; a half-written one never has that name.
    const fs::path folder = fs::temp_directory_path() / "stipple-test-data";
    const fs::path unpacked = folder / file.filename();
    if (fs::exists(unpacked)) return unpacked;
    fs::create_directories(folder);
    const fs::path partial = unpacked.string() + "." + std::to_string(::getpid());
    const std::string command = "gzip -dc '" + packed.string() + "' > '" + partial.string() + "'";
    if (std::system(command.c_str()) != 0) throw std::runtime_error("failed: " + command);
    fs::rename(partial, unpacked);
    return unpacked;
}

fs::path program(std::string_view name) {
    return fs::path(STIPPLE_BIN_DIR) / name;
}

TemporaryFolder::TemporaryFolder() {
    std::string name = (fs::temp_directory_path() / "stipple-test-XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("mkdtemp " + name);
    path_ = name;
}

TemporaryFolder::~TemporaryFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
}

PointCloud sphere(std::size_t n, double noise, std::uint64_t seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> offset(-noise, noise);
    const double golden_angle = std::numbers::pi * (3.0 - std::sqrt(5.0));
    PointCloud cloud;
    for (std::size_t i = 0; i < n; ++i) {
        const double z = 1.0 - (2.0 * static_cast<double>(i) + 1.0) / static_cast<double>(n);
        const double ring = std::sqrt(1.0 - z * z);
        const double angle = golden_angle * static_cast<double>(i);
        const Vec3d direction(ring * std::cos(angle), ring * std::sin(angle), z);
        cloud.positions.push_back(
            (direction * (1.0 + (noise > 0 ? offset(random) : 0.0))).cast<float>());
    }
    return cloud;
}

PointCloud plane(std::size_t n, std::uint64_t seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<float> unit(0.0F, 1.0F);
    PointCloud cloud;
    for (std::size_t i = 0; i < n; ++i) {
        const float x = unit(random), y = unit(random);
        cloud.positions.emplace_back(x, y, 0.0F);
    }
    return cloud;
}

PointCloud wall(std::size_t n, float gap, std::uint64_t seed) {
    PointCloud cloud = plane(n, seed);
    for (std::size_t i = 0; i < n; i += 2) cloud.positions[i].z() = gap;
    for (const Vec3f& p : cloud.positions)
        cloud.colors.push_back(p.z() == 0 ? Rgba8{255, 0, 0, 255} : Rgba8{0, 0, 255, 255});
    return cloud;
}

PointCloud line(std::size_t n) {
    PointCloud cloud;
    for (std::size_t i = 0; i < n; ++i) {
        const float t = static_cast<float>(i) / static_cast<float>(n);
        cloud.positions.emplace_back(t, 2.0F * t, -t);
    }
    return cloud;
}

PointCloud cube(std::size_t n, std::uint64_t seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<float> unit(0.0F, 1.0F);
    PointCloud cloud;
    for (std::size_t i = 0; i < n; ++i) {
        const float x = unit(random), y = unit(random), z = unit(random);
        cloud.positions.emplace_back(x, y, z);
    }
    return cloud;
}

PointCloud with_attributes(PointCloud cloud) {
    std::vector<float> height;
    std::vector<std::int32_t> label;
    for (const Vec3f& p : cloud.positions) {
        cloud.normals.push_back(p.norm() > 0 ? Vec3f(p.normalized()) : Vec3f(0, 0, 1));
        const auto channel = [](float v) {
            return static_cast<std::uint8_t>(std::clamp(127.5F + 127.5F * v, 0.0F, 255.0F));
        };
        cloud.colors.push_back({channel(p.x()), channel(p.y()), channel(p.z()), 255});
        height.push_back(p.z());
        label.push_back(p.x() < 0 ? 7 : 1'000'003);
    }
    cloud.attributes.push_back({"height", std::move(height), 1, Reduction::Mean});
    cloud.attributes.push_back({"label", std::move(label), 1, Reduction::Nearest});
    return cloud;
}

}  // namespace stipple::test
