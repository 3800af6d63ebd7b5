#include "stipple/proto/potree.hpp"

#include "json_reader.hpp"
#include "stipple/known_attributes.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <functional>
#include <span>
#include <string_view>
#include <type_traits>
#include <utility>

// Follows: Schütz, Ohrhallinger, Wimmer, Fast Out-of-Core Octree Generation for Massive Point
// Clouds, 2020 (the format 2.0 of Potree), of the points of `SampledOctree`. A single chunk of
// hierarchy, no proxies.

namespace stipple::proto {

namespace {

namespace fs = std::filesystem;

constexpr unsigned kPositionBits = 30;

std::uint8_t child_mask(const SampledOctree::Node& node) {
    unsigned mask = 0;
    for (unsigned i = 0; i < node.children.size(); ++i)
        if (node.children[i] >= 0) mask |= 1U << i;
    return static_cast<std::uint8_t>(mask);
}

/// Potree wants cubes; a cloud in one place has one, too.
OctreeCube cube_around(const PointCloud& cloud) {
    const Aabb box = bounds(cloud);
    const double side = (box.max - box.min).maxCoeff();
    return {box.min, (side > 0 ? side : 1) / ((1U << kPositionBits) - 1), kPositionBits};
}

/// One attribute of the file: how it is described, and its bytes of a point.
struct Column {
    std::string name, type;
    unsigned size = 0, elements = 1;
    std::vector<double> min, max;
    std::function<void(std::size_t at, std::byte* to)> write;  ///< of the point in that place

    Json json() const {
        return {{"name", name},
                {"description", ""},
                {"size", size},
                {"numElements", elements},
                {"elementSize", size / elements},
                {"type", type},
                {"min", min},
                {"max", max}};
    }
};

template <typename T>
std::string type_name() {
    const std::string bits = std::to_string(8 * sizeof(T));
    if constexpr (std::is_same_v<T, float>) return "float";
    if constexpr (std::is_same_v<T, double>) return "double";
    return (std::is_unsigned_v<T> ? "uint" : "int") + bits;
}

/// @param order  of the points in the file. @param value  of a point.
template <typename T, typename Value>
Column scalar_column(std::string name, std::span<const Index> order, Value value) {
    // JSON has no others than finite numbers.
    double least = INFINITY, most = -INFINITY;
    for (const Index point : order) {
        const auto number = static_cast<double>(value(point));
        if (!std::isfinite(number)) continue;
        least = std::min(least, number);
        most = std::max(most, number);
    }
    if (least > most) least = most = 0;
    return {std::move(name),
            type_name<T>(),
            sizeof(T),
            1,
            {least},
            {most},
            [order, value](std::size_t at, std::byte* to) {
                const T v = value(order[at]);
                std::memcpy(to, &v, sizeof v);
            }};
}

/// The name of an attribute; another one for those that loaders take for columns of their own, and
/// for one that is there.
std::string free_name(std::string name, std::span<const Column> columns) {
    constexpr std::array<std::string_view, 9> kOfLoaders = {
        "position", "POSITION_CARTESIAN", "rgb", "rgba", "RGBA", "NORMAL", "NormalX", "NormalY",
        "NormalZ"};
    while (std::ranges::find(kOfLoaders, name) != kOfLoaders.end() ||
           std::ranges::find(columns, name, &Column::name) != columns.end())
        name += '_';
    return name;
}

/// Of the points as they are rounded; loaders fit the view to it.
Aabb box_of(const SampledOctree& octree) {
    SampledOctree::Position low = octree.positions().front(), high = low;
    for (const SampledOctree::Position& p : octree.positions()) {
        for (int axis = 0; axis < 3; ++axis) {
            low[axis] = std::min(low[axis], p[axis]);
            high[axis] = std::max(high[axis], p[axis]);
        }
    }
    const auto place = [&octree](const SampledOctree::Position& p) -> Vec3d {
        return octree.cube().low + octree.cube().step * Vec3d(p[0], p[1], p[2]);
    };
    return {place(low), place(high)};
}

/// What viewers of Potree know of LAS under names of their own; their filters ask for these.
std::string potree_name(const std::string& name) {
    static constexpr std::array<std::pair<std::string_view, std::string_view>, 8> kKnown = {{
        {"intensity", "intensity"},
        {"classification", "classification"},
        {"return_number", "return number"},
        {"number_of_returns", "number of returns"},
        {"point_source_id", "point source id"},
        {"user_data", "user data"},
        {"scan_angle", "scan angle"},
        {"gps_time", "gps-time"},
    }};
    for (const auto& [known, theirs] : kKnown)
        if (is_known_as(name, known)) return std::string(theirs);
    return name;
}

std::vector<Column> columns_of(const PointCloud& cloud, const SampledOctree& octree) {
    std::vector<Column> columns;
    const std::span<const Index> order = octree.order();
    const Aabb box = box_of(octree);
    columns.push_back({"position",
                       "int32",
                       12,
                       3,
                       {box.min.x(), box.min.y(), box.min.z()},
                       {box.max.x(), box.max.y(), box.max.z()},
                       [positions = octree.positions()](std::size_t at, std::byte* to) {
                           std::memcpy(to, &positions[at], sizeof positions[at]);
                       }});
    if (!cloud.colors.empty()) {
        columns.push_back({"rgb",
                           "uint16",
                           6,
                           3,
                           {0, 0, 0},
                           {65535, 65535, 65535},
                           [&cloud, order](std::size_t at, std::byte* to) {
                               const Rgba8 c = cloud.colors[order[at]];
                               const std::array<std::uint16_t, 3> rgb = {
                                   static_cast<std::uint16_t>(257 * c.r),
                                   static_cast<std::uint16_t>(257 * c.g),
                                   static_cast<std::uint16_t>(257 * c.b)};
                               std::memcpy(to, rgb.data(), sizeof rgb);
                           }});
        if (cloud.has_alpha)
            columns.push_back(scalar_column<std::uint8_t>(
                "alpha", order, [&cloud](Index i) { return cloud.colors[i].a; }));
    }
    for (int axis = 0; !cloud.normals.empty() && axis < 3; ++axis) {
        columns.push_back(
            scalar_column<float>(std::string("Normal") + "XYZ"[axis], order,
                                 [&cloud, axis](Index i) { return cloud.normals[i][axis]; }));
    }
    for (const Attribute& attribute : cloud.attributes) {
        for (unsigned c = 0; c < attribute.components; ++c) {
            const std::string name = attribute.components == 1
                                         ? potree_name(attribute.name)
                                         : attribute.name + "_" + std::to_string(c);
            std::visit(
                [&](const auto& values) {
                    using T = typename std::decay_t<decltype(values)>::value_type;
                    columns.push_back(
                        scalar_column<T>(free_name(name, columns), order,
                                         [&values, n = attribute.components, c](Index i) {
                                             return values[std::size_t{n} * i + c];
                                         }));
                },
                attribute.values);
        }
    }
    return columns;
}

template <typename T>
void put(std::string& to, T value) {
    to.append(reinterpret_cast<const char*>(&value), sizeof value);
}

/// Nodes breadth first: type, children, points, place and size in octree.bin.
std::string hierarchy_of(std::span<const SampledOctree::Node> nodes, std::uint64_t point_bytes) {
    std::string bytes;
    std::vector<std::int32_t> at{0};
    for (std::size_t i = 0; i < at.size(); ++i) {
        const SampledOctree::Node& node = nodes[static_cast<std::size_t>(at[i])];
        const std::uint8_t mask = child_mask(node);
        put<std::uint8_t>(bytes, mask == 0 ? 1 : 0);
        put<std::uint8_t>(bytes, mask);
        put<std::uint32_t>(bytes, node.count);
        put<std::uint64_t>(bytes, node.first * point_bytes);
        put<std::uint64_t>(bytes, node.count * point_bytes);
        for (const std::int32_t child : node.children)
            if (child >= 0) at.push_back(child);
    }
    return bytes;
}

void write_file(const fs::path& file, const std::function<void(std::ofstream&)>& write) {
    std::ofstream stream(file, std::ios::binary);
    write(stream);
    stream.close();
    if (!stream) throw Error(ErrorCode::Internal, file.string() + ": cannot be written");
}

void write_points(std::ofstream& stream, const SampledOctree& octree,
                  std::span<const Column> columns, std::size_t point_bytes,
                  const RunContext& context) {
    constexpr std::size_t kBlock = 4096;
    const std::size_t points = octree.order().size();
    for (std::size_t begin = 0; begin < points; begin += kBlock) {
        context.throw_if_stopped();
        const std::size_t end = std::min(points, begin + kBlock);
        std::vector<std::byte> bytes((end - begin) * point_bytes);
        std::byte* to = bytes.data();
        for (std::size_t at = begin; at < end; ++at) {
            for (const Column& column : columns) {
                column.write(at, to);
                to += column.size;
            }
        }
        stream.write(reinterpret_cast<const char*>(bytes.data()),
                     static_cast<std::streamsize>(bytes.size()));
    }
}

}  // namespace

void write_potree(const PointCloud& cloud, const fs::path& folder, const PotreeOptions& options,
                  const RunContext& context) {
    const SampledOctree octree(cloud, cube_around(cloud), options.octree, context);
    const std::vector<Column> columns = columns_of(cloud, octree);
    std::size_t point_bytes = 0;
    Json attributes = Json::array();
    for (const Column& column : columns) {
        point_bytes += column.size;
        attributes.push_back(column.json());
    }
    const std::string hierarchy = hierarchy_of(octree.nodes(), point_bytes);
    const unsigned depth = std::ranges::max(octree.nodes(), {}, &SampledOctree::Node::depth).depth;
    const OctreeCube& cube = octree.cube();
    const Vec3d low = cube.low, high = low + Vec3d::Constant(cube.side());
    const Json metadata = {
        {"version", "2.0"},
        {"name", options.name},
        {"description", ""},
        {"points", cloud.size()},
        {"projection", ""},
        {"hierarchy",
         {{"firstChunkSize", hierarchy.size()},
          {"stepSize", options.octree.max_depth + 1},
          {"depth", depth}}},
        {"offset", {low.x(), low.y(), low.z()}},
        {"scale", {cube.step, cube.step, cube.step}},
        {"spacing", cube.side() / options.octree.grid},
        {"boundingBox",
         {{"min", {low.x(), low.y(), low.z()}}, {"max", {high.x(), high.y(), high.z()}}}},
        {"encoding", "DEFAULT"},
        {"attributes", std::move(attributes)}};

    write_file(folder / "octree.bin", [&](std::ofstream& stream) {
        write_points(stream, octree, columns, point_bytes, context);
    });
    write_file(folder / "hierarchy.bin", [&](std::ofstream& stream) { stream << hierarchy; });
    write_file(folder / "metadata.json",
               [&](std::ofstream& stream) { stream << to_text(metadata) << '\n'; });
}

}  // namespace stipple::proto
