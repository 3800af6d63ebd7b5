#include "stipple/proto/potree.hpp"

#include "stipple/error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <tuple>

namespace stipple::proto {
namespace {

using nlohmann::json;

std::string content(const std::filesystem::path& file) {
    std::ifstream stream(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
}

template <typename T>
T at(const std::string& bytes, std::size_t offset) {
    T value;
    std::memcpy(&value, bytes.data() + offset, sizeof value);
    return value;
}

/// A node as a viewer reads it: by the format's own rules, not by ours.
struct Node {
    Aabb box;
    unsigned depth = 0;
    bool leaf = false;
    std::vector<Vec3d> points{};
};

struct Folder {
    json metadata;
    std::vector<Node> nodes;

    explicit Folder(const std::filesystem::path& folder)
        : metadata(json::parse(content(folder / "metadata.json"))) {
        const std::string hierarchy = content(folder / "hierarchy.bin");
        const std::string octree = content(folder / "octree.bin");
        EXPECT_EQ(metadata["hierarchy"]["firstChunkSize"], hierarchy.size());
        EXPECT_EQ(metadata["encoding"], "DEFAULT");
        std::size_t point_bytes = 0;
        for (const json& attribute : metadata["attributes"])
            point_bytes += attribute["size"].get<std::size_t>();
        nodes.push_back({box_of(metadata["boundingBox"])});
        std::uint64_t covered = 0;
        for (std::size_t i = 0; i < nodes.size(); ++i) {
            const std::size_t entry = 22 * i;
            nodes[i].leaf = at<std::uint8_t>(hierarchy, entry) == 1;
            const auto mask = at<std::uint8_t>(hierarchy, entry + 1);
            const auto points = at<std::uint32_t>(hierarchy, entry + 2);
            const auto offset = at<std::uint64_t>(hierarchy, entry + 6);
            const auto size = at<std::uint64_t>(hierarchy, entry + 14);
            EXPECT_EQ(size, points * point_bytes);
            covered += size;
            for (std::uint32_t p = 0; p < points; ++p)
                nodes[i].points.push_back(position(octree, offset + p * point_bytes));
            EXPECT_EQ(nodes[i].leaf, mask == 0);
            for (unsigned child = 0; child < 8; ++child)
                if (mask & (1U << child)) nodes.push_back(child_of(nodes[i], child));
        }
        EXPECT_EQ(22 * nodes.size(), hierarchy.size());
        EXPECT_EQ(covered, octree.size());
    }

    std::vector<Vec3d> all_points() const {
        std::vector<Vec3d> all;
        for (const Node& node : nodes)
            all.insert(all.end(), node.points.begin(), node.points.end());
        return all;
    }

private:
    static Aabb box_of(const json& box) {
        const auto corner = [](const json& c) { return Vec3d(c[0], c[1], c[2]); };
        return {corner(box["min"]), corner(box["max"])};
    }
    Vec3d position(const std::string& octree, std::size_t offset) const {
        Vec3d p;
        for (int axis = 0; axis < 3; ++axis) {
            const auto i = static_cast<std::size_t>(axis);
            p[axis] =
                at<std::int32_t>(octree, offset + 4 * i) * metadata["scale"][i].get<double>() +
                metadata["offset"][i].get<double>();
        }
        return p;
    }
    static Node child_of(const Node& parent, unsigned index) {
        Node child{parent.box, parent.depth + 1};
        const Vec3d half = 0.5 * (parent.box.max - parent.box.min);
        for (int axis = 0; axis < 3; ++axis) {
            const bool high = (index >> (2 - axis)) & 1U;
            (high ? child.box.min[axis] += half[axis] : child.box.max[axis] -= half[axis]);
        }
        return child;
    }
};

Folder written(const PointCloud& cloud, const PotreeOptions& options) {
    const test::TemporaryFolder folder;
    write_potree(cloud, folder.path(), options);
    return Folder(folder.path());
}

auto by_place = [](const Vec3d& a, const Vec3d& b) {
    return std::make_tuple(a.x(), a.y(), a.z()) < std::make_tuple(b.x(), b.y(), b.z());
};

TEST(Potree, HasEveryPointInExactlyOneNode) {
    PointCloud cloud = test::sphere(5000);
    cloud.origin = Vec3d(500'000, -20, 3);
    const Folder folder = written(cloud, {.octree = {.grid = 8, .max_points = 100}});
    EXPECT_EQ(folder.metadata["points"], 5000);
    std::vector<Vec3d> found = folder.all_points(), expected;
    ASSERT_EQ(found.size(), 5000U);
    for (const Vec3f& p : cloud.positions) expected.push_back(cloud.origin + p.cast<double>());
    std::ranges::sort(found, by_place);
    std::ranges::sort(expected, by_place);
    for (std::size_t i = 0; i < found.size(); ++i)
        EXPECT_LT((found[i] - expected[i]).norm(), 1e-6) << i;
}

TEST(Potree, KeepsPointsInTheCubesOfTheirNodes) {
    const Folder folder = written(test::sphere(5000), {.octree = {.grid = 8, .max_points = 100}});
    EXPECT_GT(folder.nodes.size(), 50U);
    for (const Node& node : folder.nodes) {
        EXPECT_TRUE(!node.leaf || node.points.size() <= 100U);
        for (const Vec3d& p : node.points) {
            EXPECT_GE((p - node.box.min).minCoeff(), -1e-8);
            EXPECT_GE((node.box.max - p).minCoeff(), -1e-8);
        }
    }
}

TEST(Potree, SamplesInnerNodesEvenly) {
    const Folder folder =
        written(test::sphere(20'000), {.octree = {.grid = 16, .max_points = 100}});
    const Node& root = folder.nodes.front();
    const double cell = (root.box.max - root.box.min).x() / 16;
    std::set<std::array<long, 3>> cells;
    for (const Vec3d& p : root.points) {
        std::array<long, 3> key{};
        for (int axis = 0; axis < 3; ++axis)
            key[static_cast<std::size_t>(axis)] =
                std::min(15L, std::lround(std::floor((p - root.box.min)[axis] / cell)));
        EXPECT_TRUE(cells.insert(key).second);
    }
    EXPECT_GT(cells.size(), 300U);
    EXPECT_EQ(folder.metadata["spacing"], cell);
}

TEST(Potree, NamesEveryAttributeWithItsTypeAndRange) {
    const PointCloud cloud = test::with_attributes(test::sphere(500));
    const Folder folder = written(cloud, {});
    std::map<std::string, json> attributes;
    for (const json& attribute : folder.metadata["attributes"])
        attributes[attribute["name"]] = attribute;
    EXPECT_EQ(attributes["position"]["type"], "int32");
    EXPECT_EQ(attributes["rgb"]["numElements"], 3);
    EXPECT_EQ(attributes["NormalZ"]["type"], "float");
    EXPECT_LE(attributes["NormalZ"]["max"][0], 1.0F);
    for (const Attribute& attribute : cloud.attributes)
        EXPECT_TRUE(attributes.contains(attribute.components == 1 ? attribute.name
                                                                  : attribute.name + "_0"));
}

TEST(Potree, TellsTheBoxOfItsPointsBesideItsCube) {
    PointCloud cloud = test::sphere(500);
    for (Vec3f& p : cloud.positions) p.z() *= 0.1F;
    const Folder folder = written(cloud, {});
    const json position = folder.metadata["attributes"][0];
    ASSERT_EQ(position["name"], "position");
    const Aabb box = bounds(cloud);
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto k = static_cast<Eigen::Index>(axis);
        EXPECT_NEAR(position["min"][axis], box.min[k], 1e-6);
        EXPECT_NEAR(position["max"][axis], box.max[k], 1e-6);
    }
    EXPECT_GT(folder.metadata["boundingBox"]["max"][2], 1.0);
}

TEST(Potree, GivesNoAttributeTheNameOfAColumnOfLoaders) {
    PointCloud cloud = test::sphere(4);
    cloud.colors.assign(4, {1, 2, 3, 4});
    cloud.has_alpha = true;
    for (const char* name : {"rgb", "position", "alpha", "fine"})
        cloud.attributes.push_back({name, std::vector<float>(4, 1.0F)});
    const Folder folder = written(cloud, {});
    std::vector<std::string> names;
    for (const json& attribute : folder.metadata["attributes"]) names.push_back(attribute["name"]);
    EXPECT_EQ(names, (std::vector<std::string>{"position", "rgb", "alpha", "rgb_", "position_",
                                               "alpha_", "fine"}));
}

TEST(Potree, GivesTheFieldsOfLasTheNamesThatViewersFilterBy) {
    PointCloud cloud = test::sphere(4);
    for (const char* name : {"scalar_Classification", "GpsTime", "return_number", "scalar_Other"})
        cloud.attributes.push_back({name, std::vector<float>(4, 1.0F)});
    const Folder folder = written(cloud, {});
    std::vector<std::string> names;
    for (const json& attribute : folder.metadata["attributes"]) names.push_back(attribute["name"]);
    EXPECT_EQ(names, (std::vector<std::string>{"position", "classification", "gps-time",
                                               "return number", "scalar_Other"}));
}

TEST(Potree, TellsTheRangeOfFiniteValues) {
    PointCloud cloud = test::sphere(4);
    const float inf = std::numeric_limits<float>::infinity();
    cloud.attributes.push_back({"some", std::vector<float>{NAN, 2, -inf, 1}});
    cloud.attributes.push_back({"none", std::vector<float>(4, NAN)});
    const Folder folder = written(cloud, {});
    for (const json& attribute : folder.metadata["attributes"]) {
        if (attribute["name"] == "some") {
            EXPECT_EQ(attribute["min"], json::array({1.0}));
            EXPECT_EQ(attribute["max"], json::array({2.0}));
        }
        if (attribute["name"] == "none") {
            EXPECT_EQ(attribute["min"], json::array({0.0}));
        }
    }
}

TEST(Potree, TakesDegenerateClouds) {
    EXPECT_EQ(written(test::sphere(1), {}).all_points().size(), 1U);
    EXPECT_EQ(
        written(test::line(1000), {.octree = {.grid = 4, .max_points = 10}}).all_points().size(),
        1000U);
    PointCloud same;
    same.positions.assign(500, Vec3f(1, 2, 3));
    const Folder folder = written(same, {.octree = {.grid = 4, .max_points = 10}});
    EXPECT_EQ(folder.all_points().size(), 500U);
    EXPECT_LE(folder.nodes.size(), 22U);
    EXPECT_THROW(written({}, {}), Error);
    EXPECT_THROW(written(same, {.octree = {.grid = 1}}), Error);
}

}  // namespace
}  // namespace stipple::proto
