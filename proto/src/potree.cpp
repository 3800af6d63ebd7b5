#include "stipple/proto/potree.hpp"

#include "json_reader.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <functional>
#include <numeric>
#include <span>
#include <tuple>
#include <type_traits>

// Follows: Schütz, Ohrhallinger, Wimmer, Fast Out-of-Core Octree Generation for Massive Point
// Clouds, 2020 (the format 2.0 of Potree), with the sampling by grid of Potree 1. A single chunk of
// hierarchy, no proxies.

namespace stipple::proto {

namespace {

namespace fs = std::filesystem;

constexpr unsigned kMaxDepth = 21;
constexpr double kPositionSteps = 1 << 30;

struct Node {
    std::uint32_t first = 0, count = 0;  ///< of its own points, in the order of the file
    std::array<std::int32_t, 8> children{-1, -1, -1, -1, -1, -1, -1, -1};
    unsigned depth = 0;

    std::uint8_t child_mask() const {
        std::uint8_t mask = 0;
        for (unsigned i = 0; i < 8; ++i)
            if (children[i] >= 0) mask = static_cast<std::uint8_t>(mask | (1U << i));
        return mask;
    }
};

/// Potree numbers children by x, y, z from the highest bit.
unsigned octant(const Vec3d& p, const Vec3d& middle) {
    return (p.x() >= middle.x() ? 4U : 0U) | (p.y() >= middle.y() ? 2U : 0U) |
           (p.z() >= middle.z() ? 1U : 0U);
}

class Octree {
public:
    Octree(const PointCloud& cloud, const PotreeOptions& options, const RunContext& context)
        : cloud_(cloud), options_(options), context_(context) {
        const Aabb box = bounds(cloud);
        const double side = (box.max - box.min).maxCoeff();
        // Potree wants cubes; a cloud in one place has one, too.
        side_ = side > 0 ? side : 1;
        low_ = box.min;
        std::vector<Index> all(cloud.size());
        std::iota(all.begin(), all.end(), Index{0});
        order_.reserve(cloud.size());
        build(all, low_, side_, 0);
    }

    const std::vector<Node>& nodes() const noexcept { return nodes_; }
    const std::vector<Index>& order() const noexcept { return order_; }
    const Vec3d& low() const noexcept { return low_; }
    double side() const noexcept { return side_; }
    Vec3d position(Index i) const { return cloud_.origin + cloud_.positions[i].cast<double>(); }

private:
    std::int32_t build(std::vector<Index>& points, const Vec3d& low, double side, unsigned depth) {
        context_.throw_if_stopped();
        const auto number = static_cast<std::int32_t>(nodes_.size());
        nodes_.emplace_back().depth = depth;
        const bool leaf = points.size() <= options_.max_points || depth == kMaxDepth;
        const std::size_t kept = leaf ? points.size() : sample(points, low, side);
        nodes_[static_cast<std::size_t>(number)].first = static_cast<std::uint32_t>(order_.size());
        nodes_[static_cast<std::size_t>(number)].count = static_cast<std::uint32_t>(kept);
        const auto own = points.begin() + static_cast<std::ptrdiff_t>(kept);
        order_.insert(order_.end(), points.begin(), own);

        std::array<std::vector<Index>, 8> parts;
        const Vec3d middle = low + Vec3d::Constant(side / 2);
        for (auto i = own; i != points.end(); ++i)
            parts[octant(position(*i), middle)].push_back(*i);
        std::vector<Index>().swap(points);
        for (unsigned i = 0; i < 8; ++i) {
            if (parts[i].empty()) continue;
            const Vec3d corner(low.x() + (i & 4U ? side / 2 : 0), low.y() + (i & 2U ? side / 2 : 0),
                               low.z() + (i & 1U ? side / 2 : 0));
            const std::int32_t child = build(parts[i], corner, side / 2, depth + 1);
            nodes_[static_cast<std::size_t>(number)].children[i] = child;
        }
        return number;
    }

    /// Moves the points that the node keeps to the front, the rest behind them, both in order.
    std::size_t sample(std::vector<Index>& points, const Vec3d& low, double side) {
        struct Candidate {
            std::uint64_t cell;
            double distance_sq;
            Index point;
        };
        const double cell_side = side / options_.grid;
        std::vector<Candidate> candidates;
        candidates.reserve(points.size());
        for (const Index point : points) {
            const Vec3d p = (position(point) - low) / cell_side;
            std::uint64_t cell = 0;
            Vec3d middle;
            for (int axis = 0; axis < 3; ++axis) {
                const double c =
                    std::clamp(std::floor(p[axis]), 0.0, static_cast<double>(options_.grid - 1));
                cell = cell * options_.grid + static_cast<std::uint64_t>(c);
                middle[axis] = c + 0.5;
            }
            candidates.push_back({cell, (p - middle).squaredNorm(), point});
        }
        std::ranges::sort(candidates, [](const Candidate& a, const Candidate& b) {
            return std::tie(a.cell, a.distance_sq, a.point) <
                   std::tie(b.cell, b.distance_sq, b.point);
        });
        std::vector<Index> kept, rest;
        for (std::size_t i = 0; i < candidates.size(); ++i) {
            const bool first = i == 0 || candidates[i].cell != candidates[i - 1].cell;
            (first ? kept : rest).push_back(candidates[i].point);
        }
        std::ranges::copy(kept, points.begin());
        std::ranges::copy(rest, points.begin() + static_cast<std::ptrdiff_t>(kept.size()));
        return kept.size();
    }

    const PointCloud& cloud_;
    const PotreeOptions& options_;
    const RunContext& context_;
    Vec3d low_;
    double side_ = 1;
    std::vector<Node> nodes_;   ///< depth first
    std::vector<Index> order_;  ///< points, node by node
};

/// One attribute of the file: how it is described, and its bytes of a point.
struct Column {
    std::string name, type;
    unsigned size = 0, elements = 1;
    std::vector<double> min, max;
    std::function<void(Index point, std::byte* to)> write;

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

/// @param value  of a point.
template <typename T, typename Value>
Column scalar_column(std::string name, std::size_t points, Value value) {
    T least = points > 0 ? value(0) : T{}, most = least;
    for (std::size_t i = 1; i < points; ++i) {
        least = std::min(least, value(static_cast<Index>(i)));
        most = std::max(most, value(static_cast<Index>(i)));
    }
    return {std::move(name),
            type_name<T>(),
            sizeof(T),
            1,
            {static_cast<double>(least)},
            {static_cast<double>(most)},
            [value](Index point, std::byte* to) {
                const T v = value(point);
                std::memcpy(to, &v, sizeof v);
            }};
}

std::vector<Column> columns_of(const PointCloud& cloud, const Octree& octree) {
    std::vector<Column> columns;
    const Vec3d low = octree.low(), high = low + Vec3d::Constant(octree.side());
    const double steps = kPositionSteps / octree.side();
    columns.push_back({"position",
                       "int32",
                       12,
                       3,
                       {low.x(), low.y(), low.z()},
                       {high.x(), high.y(), high.z()},
                       [&octree, low, steps](Index i, std::byte* to) {
                           const Vec3d p = (octree.position(i) - low) * steps;
                           for (int axis = 0; axis < 3; ++axis) {
                               const auto v = static_cast<std::int32_t>(std::lround(p[axis]));
                               std::memcpy(to + 4 * axis, &v, sizeof v);
                           }
                       }});
    if (!cloud.colors.empty()) {
        columns.push_back({"rgb",
                           "uint16",
                           6,
                           3,
                           {0, 0, 0},
                           {65535, 65535, 65535},
                           [&cloud](Index i, std::byte* to) {
                               const Rgba8 c = cloud.colors[i];
                               const std::array<std::uint16_t, 3> rgb = {
                                   static_cast<std::uint16_t>(257 * c.r),
                                   static_cast<std::uint16_t>(257 * c.g),
                                   static_cast<std::uint16_t>(257 * c.b)};
                               std::memcpy(to, rgb.data(), sizeof rgb);
                           }});
    }
    for (int axis = 0; !cloud.normals.empty() && axis < 3; ++axis) {
        columns.push_back(
            scalar_column<float>(std::string("Normal") + "XYZ"[axis], cloud.size(),
                                 [&cloud, axis](Index i) { return cloud.normals[i][axis]; }));
    }
    for (const Attribute& attribute : cloud.attributes) {
        for (unsigned c = 0; c < attribute.components; ++c) {
            const std::string name = attribute.components == 1
                                         ? attribute.name
                                         : attribute.name + "_" + std::to_string(c);
            std::visit(
                [&](const auto& values) {
                    using T = typename std::decay_t<decltype(values)>::value_type;
                    columns.push_back(scalar_column<T>(
                        name, cloud.size(), [&values, n = attribute.components, c](Index i) {
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
std::string hierarchy_of(const std::vector<Node>& nodes, std::uint64_t point_bytes) {
    std::string bytes;
    std::vector<std::int32_t> at{0};
    for (std::size_t i = 0; i < at.size(); ++i) {
        const Node& node = nodes[static_cast<std::size_t>(at[i])];
        const std::uint8_t mask = node.child_mask();
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

void write_points(std::ofstream& stream, const Octree& octree, std::span<const Column> columns,
                  std::size_t point_bytes, const RunContext& context) {
    constexpr std::size_t kBlock = 4096;
    const std::span<const Index> order = octree.order();
    for (std::size_t begin = 0; begin < order.size(); begin += kBlock) {
        context.throw_if_stopped();
        const auto block = order.subspan(begin, std::min(kBlock, order.size() - begin));
        std::vector<std::byte> bytes(block.size() * point_bytes);
        std::byte* to = bytes.data();
        for (const Index point : block) {
            for (const Column& column : columns) {
                column.write(point, to);
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
    if (cloud.empty())
        throw Error(ErrorCode::InvalidArgument, "0 points: a Potree folder has at least 1");
    if (options.grid < 2 || options.grid > 1024)
        throw Error(ErrorCode::InvalidArgument,
                    "grid " + std::to_string(options.grid) + ": expected 2..1024");
    if (options.max_points == 0)
        throw Error(ErrorCode::InvalidArgument, "max_points 0: expected at least 1");

    const Octree octree(cloud, options, context);
    const std::vector<Column> columns = columns_of(cloud, octree);
    std::size_t point_bytes = 0;
    Json attributes = Json::array();
    for (const Column& column : columns) {
        point_bytes += column.size;
        attributes.push_back(column.json());
    }
    const std::string hierarchy = hierarchy_of(octree.nodes(), point_bytes);
    const unsigned depth = std::ranges::max(octree.nodes(), {}, &Node::depth).depth;
    const Vec3d low = octree.low(), high = low + Vec3d::Constant(octree.side());
    const double step = octree.side() / kPositionSteps;
    const Json metadata = {
        {"version", "2.0"},
        {"name", options.name},
        {"description", ""},
        {"points", cloud.size()},
        {"projection", ""},
        {"hierarchy",
         {{"firstChunkSize", hierarchy.size()}, {"stepSize", kMaxDepth + 1}, {"depth", depth}}},
        {"offset", {low.x(), low.y(), low.z()}},
        {"scale", {step, step, step}},
        {"spacing", octree.side() / options.grid},
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
