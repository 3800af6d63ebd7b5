#include "stipple/copc.hpp"

#include "base/byte_writer.hpp"
#include "base/first_touch.hpp"
#include "base/in_words.hpp"
#include "base/parallel_for.hpp"
#include "cloud/box_of_most.hpp"
#include "cloud/chain_order.hpp"
#include "cloud/grid_step.hpp"
#include "codec/las_fields.hpp"
#include "codec/laz_chunk.hpp"
#include "neighbors/gaps.hpp"
#include "neighbors/point_tree.hpp"
#include "stipple/error.hpp"
#include "stipple/globe.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <numeric>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>

// Follows: COPC 1.0 (copc.io), LAS 1.4 R15 (ASPRS). The hierarchy is cut into pages, so that
// readers of large files need not fetch all of it at first.

namespace stipple {

namespace {

constexpr unsigned kMostBits = 30;

// The grid.

/// By how much rounding to single precision may have moved a number, at most.
double rounding_of(float rounded) {
    constexpr std::uint32_t kExponent = 0x7f800000;
    return 0x1p-24 * static_cast<double>(
                         std::bit_cast<float>(std::bit_cast<std::uint32_t>(rounded) & kExponent));
}

/// Whether all coordinates lie on multiples of a step, as far as single precision tells: of those
/// near the origin it tells most. Of what was moved or turned, zeros are left with the dust of its
/// arithmetic.
bool lie_on_grid(const PointCloud& cloud, double step, const RunContext& context) {
    const double dust = std::ldexp(step, -static_cast<int>(kMostBits));
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        constexpr std::size_t kBetweenChecks = 65'536;
        if (i % kBetweenChecks == 0) context.throw_if_stopped();
        for (int axis = 0; axis < 3; ++axis) {
            const float p = cloud.positions[i][axis];
            const double x = cloud.origin[axis] + static_cast<double>(p);
            const double unsure = rounding_of(p) + 0x1p-50 * std::abs(x) + dust;
            if (std::abs(x - step * std::round(x / step)) > unsure) return false;
        }
    }
    return true;
}

double power_of_ten(int exponent) {
    return std::pow(10.0, exponent);
}

/// The power of ten that a file's steps are of.
int find_exponent(const PointCloud& cloud, const Aabb& box, const CopcOptions& options,
                  const RunContext& context) {
    const double side = (box.max - box.min).maxCoeff();
    // Of most: a few points that lie far off are known less well, but may lie on the grid, too.
    const Aabb most = box_of_most(some_of(
        cloud.size(), [&](std::size_t i) -> Vec3d { return cloud.positions[i].cast<double>(); }));
    const auto largest =
        static_cast<float>(most.min.cwiseAbs().cwiseMax(most.max.cwiseAbs()).maxCoeff());
    const auto fits = [side](int exponent) {
        return side / power_of_ten(exponent) < std::ldexp(1.0, kMostBits) - 2;
    };
    if (options.precision) {
        const auto exponent_of = [](double half_step) {
            return static_cast<int>(std::floor(std::log10(2 * half_step)));
        };
        const double left = precision_left(*options.precision, 0, side);
        if (!cloud.double_precision) return exponent_of(left);
        // A grid on which they lay takes back what rounding to floats has moved them by.
        const int longest = exponent_of(left);
        if (power_of_ten(longest) > 2 * rounding_of(largest) &&
            lie_on_grid(cloud, power_of_ten(longest), context))
            return longest;
        return exponent_of(precision_left(left, rounding_of_reading(cloud), side));
    }
    if (!(side > 0)) return 0;  // any
    const double unsure =
        std::max(std::ldexp(std::max(static_cast<double>(largest), longest_side(most)), -24),
                 std::ldexp(side, -static_cast<int>(kMostBits)));
    // Where half a step is what is unsure, any coordinate so far from the origin lies on the grid.
    const double least = 2 * rounding_of(largest);
    int e = static_cast<int>(std::floor(std::log10(side)));
    for (; power_of_ten(e) > least && fits(e); --e)
        if (lie_on_grid(cloud, power_of_ten(e), context)) return e;
    e = static_cast<int>(std::floor(std::log10(unsure)));
    while (!fits(e)) ++e;
    return e;
}

/// Refuses a step that most points lie nearer than, since others lie so far off.
void check_step(const PointCloud& cloud, const Aabb& box, double step, const RunContext& context) {
    constexpr double kFarOff = 1000;
    const auto place = [&](std::size_t i) {
        return Vec3d(cloud.origin + cloud.positions[i].cast<double>());
    };
    const double side = longest_side(box);
    if (!(side > kFarOff * longest_side(box_of_most(some_of(cloud.size(), place))))) return;
    const double gap = median_gap(PointTree(cloud.positions, PointTree::Leaves::Loose, context));
    if (gap == 0 || step <= gap) return;
    throw Error(ErrorCode::InvalidArgument,
                "the cloud is " + in_words(side) + " wide, and its points lie about " +
                    in_words(gap) + " apart: steps of " + in_words(step) +
                    " cannot tell them apart; remove far-off points, or set a precision");
}

OctreeCube cube_of(const PointCloud& cloud, const CopcOptions& options, const RunContext& context) {
    const Aabb box = bounds(cloud);
    const double step = power_of_ten(find_exponent(cloud, box, options, context));
    if (!options.precision) check_step(cloud, box, step, context);
    const bool is_one_place = box.min == box.max;
    const Vec3d low = is_one_place ? box.min : (step * (box.min / step).array().floor()).matrix();
    const double steps = std::round((box.max - low).maxCoeff() / step);
    if (!(low.allFinite() && steps < std::ldexp(1.0, kMostBits))) {
        if (!options.precision)
            throw Error(ErrorCode::InvalidArgument,
                        "coordinates around " + in_words(box.max.cwiseAbs().maxCoeff()) +
                            ": expected a range that a grid of 2^30 steps can hold");
        throw Error(ErrorCode::InvalidArgument,
                    "precision " + in_words(*options.precision) +
                        ": the cloud is more than 2^30 steps wide; choose a longer one");
    }
    const auto bits = static_cast<unsigned>(std::bit_width(static_cast<std::uint32_t>(steps)));
    return {low, step, std::max(bits, 1U)};
}

/// The points of a node along a chain, which takes a twentieth fewer bytes than their curve.
LazPoints points_of_node(const PointCloud& cloud, const LasFields& fields,
                         const SampledOctree& octree, const SampledOctree::Node& node) {
    const auto order = octree.order().subspan(node.first, node.count);
    const auto positions = octree.positions().subspan(node.first, node.count);
    std::vector<Vec3f> places;
    for (const Index i : order) places.push_back(cloud.positions[i]);
    RunContext alone;
    alone.threads = 1;
    const std::vector<Index> chain = chain_through(places, alone);
    const auto along_chain = [&]<typename Value>(const std::vector<Value>& values) {
        std::vector<Value> along(values.empty() ? 0 : chain.size());
        for (std::size_t i = 0; i < along.size(); ++i) along[i] = values[order[chain[i]]];
        return along;
    };
    LazPoints points{.positions = {},
                     .intensities = along_chain(fields.intensities),
                     .returns = along_chain(fields.returns),
                     .classifications = along_chain(fields.classifications),
                     .user_data = along_chain(fields.user_data),
                     .flags = along_chain(fields.flags),
                     .sources = along_chain(fields.sources),
                     .times = along_chain(fields.times),
                     .colors = along_chain(cloud.colors),
                     .extra_size = fields.extra_size};
    points.positions.reserve(order.size());
    points.extras.reserve(order.size() * fields.extra_size);
    for (const Index at : chain) {
        points.positions.push_back(positions[at]);
        for (const LasExtraField& field : fields.extras) {
            const std::byte* const value = field.first + order[at] * field.stride;
            points.extras.insert(points.extras.end(), value, value + field.size);
        }
    }
    return points;
}

// The file.

constexpr std::size_t kHeaderSize = 375, kExtendedRecordHead = 60;
constexpr std::size_t kInfoSize = 160, kEntrySize = 32;
constexpr std::size_t kTablePointer = 8;  // before the first chunk

void put_record_head(ByteWriter& to, std::string_view user, std::uint16_t id, std::size_t size,
                     std::string_view description) {
    to.put<std::uint16_t>(0);
    to.put_padded(user, 16);
    to.put(id);
    to.put(static_cast<std::uint16_t>(size));
    to.put_padded(description, 32);
}

/// How readers are to take the chunks apart.
void put_laszip_record(ByteWriter& to, bool has_colors, std::size_t extra_size) {
    struct Item {
        std::uint16_t type, size;
    };
    std::vector<Item> items{{10, kLazPointSize}};
    if (has_colors) items.push_back({11, kLazColorSize});
    if (extra_size > 0) items.push_back({14, static_cast<std::uint16_t>(extra_size)});
    put_record_head(to, "laszip encoded", 22204, 34 + 6 * items.size(), "LASzip");
    to.put<std::uint16_t>(3);  // layered chunks
    to.put<std::uint16_t>(0);  // arithmetic coder
    to.put<std::uint8_t>(3);   // version 3.4.3
    to.put<std::uint8_t>(4);
    to.put<std::uint16_t>(3);
    to.put<std::uint32_t>(0);           // options
    to.put<std::uint32_t>(0xFFFFFFFF);  // points of a chunk: as the table says
    to.put<std::int64_t>(-1);           // special records: none
    to.put<std::int64_t>(-1);
    to.put(static_cast<std::uint16_t>(items.size()));
    for (const Item& item : items) {
        to.put(item.type);
        to.put(item.size);
        to.put<std::uint16_t>(3);
    }
}

void put_extra_fields_record(ByteWriter& to, std::span<const LasExtraField> fields) {
    put_record_head(to, "LASF_Spec", 4, kExtraFieldSize * fields.size(), "Extra bytes");
    for (const LasExtraField& field : fields) {
        to.put_zeros(2);
        to.put(field.type);
        to.put<std::uint8_t>(0);  // options
        to.put_padded(field.name, 32);
        to.put_zeros(kExtraFieldSize - 36);
    }
}

/// LAS asks for a system, and some readers refuse files without one. Of this one nothing is known
/// but that it is no map's; 32767 is a local datum of any kind (OGC 01-009).
constexpr std::string_view kUnknownSystem =
    "LOCAL_CS[\"unknown\",LOCAL_DATUM[\"unknown\",32767],UNIT[\"unknown\",1],"
    "AXIS[\"X\",EAST],AXIS[\"Y\",NORTH]]";

void put_system_record(ByteWriter& to, std::optional<unsigned> epsg) {
    const std::string text = epsg ? well_known_text(*epsg) : std::string(kUnknownSystem);
    put_record_head(to, "LASF_Projection", 2112, text.size() + 1, "OGC WKT");
    to.put(text);
    to.put_zeros(1);
}

/// Of the points' coordinates as the file has them.
Aabb bounds_on_grid(const SampledOctree& octree) {
    SampledOctree::Position least = octree.positions().front(), most = least;
    for (const SampledOctree::Position& p : octree.positions()) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            least[axis] = std::min(least[axis], p[axis]);
            most[axis] = std::max(most[axis], p[axis]);
        }
    }
    const auto place = [&](const SampledOctree::Position& p) {
        return Vec3d(octree.cube().low + octree.cube().step * Vec3d(p[0], p[1], p[2]));
    };
    return {place(least), place(most)};
}

/// A node's chunk in the file.
struct Chunk {
    std::uint64_t offset = 0;
    LazChunkSize size{};
};

/// The nodes as their chunks stand in the file: those of the octree's upper depths first, so that a
/// reader of the coarsest ones reads on.
std::vector<std::size_t> order_of_file(std::span<const SampledOctree::Node> nodes) {
    std::vector<std::size_t> order(nodes.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::ranges::stable_sort(order, {}, [&](std::size_t n) { return nodes[n].depth; });
    return order;
}

/// @return  where they are, by the numbers of the nodes.
std::vector<Chunk> append_chunks(ByteWriter& file, std::span<const SampledOctree::Node> nodes,
                                 std::span<const std::size_t> order,
                                 std::vector<std::vector<std::byte>>&& encoded,
                                 const RunContext& context) {
    std::size_t bytes = 0;
    for (const std::vector<std::byte>& chunk : encoded) bytes += chunk.size();
    reserve_in_blocks(file.bytes, file.bytes.size() + bytes + kEntrySize * nodes.size(),
                      context);  // about all
    std::vector<Chunk> chunks(nodes.size());
    for (const std::size_t n : order) {
        constexpr std::size_t kMost = INT32_MAX;  // as the hierarchy tells it
        if (encoded[n].size() > kMost)
            throw Error(ErrorCode::TooLarge, "COPC: " + std::to_string(nodes[n].count) +
                                                 " points in one place take " +
                                                 std::to_string(encoded[n].size()) +
                                                 " bytes: expected at most 2^31 - 1; choose a "
                                                 "shorter precision");
        chunks[n] = {file.bytes.size(),
                     {nodes[n].count, static_cast<std::uint32_t>(encoded[n].size())}};
        file.put(encoded[n]);
        std::vector<std::byte>().swap(encoded[n]);
    }
    return chunks;
}

/// The nodes as readers find them: pages, each with the nodes of some depths below one node, and
/// where the pages of the larger branches below them are.
class Hierarchy {
public:
    /// @param offset  of the pages in the file.
    Hierarchy(std::span<const SampledOctree::Node> nodes, std::span<const Chunk> chunks,
              std::uint64_t offset)
        : nodes_(nodes), chunks_(chunks), branches_(nodes.size(), 1), offset_(offset) {
        for (std::size_t n = nodes.size(); n-- > 0;)
            for (const std::int32_t child : nodes[n].children)
                if (child >= 0) branches_[n] += branches_[static_cast<std::size_t>(child)];
        root_size_ = write_page(0);
    }

    std::span<const std::byte> pages() const noexcept { return pages_; }
    /// The root's page comes last, since it names the others.
    std::uint64_t root_offset() const noexcept { return offset_ + pages_.size() - root_size_; }
    std::uint64_t root_size() const noexcept { return root_size_; }

private:
    /// @return  its size; it ends where the pages do.
    std::uint64_t write_page(std::size_t root) {
        constexpr unsigned kDepths = 5;    // some 1,400 nodes of a surface
        constexpr std::size_t kFew = 256;  // nodes of a branch that need no page of their own
        ByteWriter page;
        std::vector<std::size_t> left{root};
        for (std::size_t i = 0; i < left.size(); ++i) {
            const SampledOctree::Node& node = nodes_[left[i]];
            if (node.depth == nodes_[root].depth + kDepths && branches_[left[i]] > kFew) {
                const std::uint64_t size = write_page(left[i]);
                put_entry(page, node, offset_ + pages_.size() - size, size, -1);
                continue;
            }
            const Chunk& chunk = chunks_[left[i]];
            put_entry(page, node, chunk.offset, chunk.size.bytes,
                      static_cast<std::int32_t>(node.count));
            for (const std::int32_t child : node.children)
                if (child >= 0) left.push_back(static_cast<std::size_t>(child));
        }
        pages_.insert(pages_.end(), page.bytes.begin(), page.bytes.end());
        return page.bytes.size();
    }
    static void put_entry(ByteWriter& to, const SampledOctree::Node& node, std::uint64_t offset,
                          std::uint64_t size, std::int32_t points) {
        to.put(static_cast<std::int32_t>(node.depth));
        for (const std::int32_t coordinate : node.place) to.put(coordinate);
        to.put(offset);
        to.put(static_cast<std::int32_t>(size));
        to.put(points);
    }

    std::span<const SampledOctree::Node> nodes_;
    std::span<const Chunk> chunks_;
    std::vector<std::size_t> branches_;  ///< of each node: it and how many are below it
    std::vector<std::byte> pages_;
    std::uint64_t offset_, root_size_ = 0;
};

constexpr std::size_t kReturns = 15;

/// How many points are the first return of their pulse, the second, and so on.
std::array<std::uint64_t, kReturns> points_by_return(const LasFields& fields,
                                                     std::uint64_t points) {
    std::array<std::uint64_t, kReturns> counts{};
    for (const LazReturn& r : fields.returns) ++counts[r.number - 1U];
    if (fields.returns.empty()) counts.front() = points;
    return counts;
}

/// The least and the greatest time.
std::pair<double, double> times_of(const LasFields& fields) {
    if (fields.times.empty()) return {0, 0};
    const auto [least, greatest] = std::ranges::minmax(fields.times);
    return {least, greatest};
}

/// All that stands before the points.
struct Head {
    OctreeCube cube;
    Aabb box;  ///< of the points on the grid
    std::uint64_t points = 0;
    double spacing = 0;  ///< of the points of the root
    bool has_colors = false;
    std::array<std::uint64_t, kReturns> by_return{};
    std::pair<double, double> times{};
    const LasFields& fields;
    std::optional<unsigned> epsg{};
    /// What is known once the chunks are.
    std::uint64_t hierarchy_record = 0, root_offset = 0, root_size = 0;

    std::vector<std::byte> bytes() const {
        ByteWriter records;
        put_info(records);
        put_laszip_record(records, has_colors, fields.extra_size);
        if (!fields.extras.empty()) put_extra_fields_record(records, fields.extras);
        put_system_record(records, epsg);
        const unsigned count = 3 + (fields.extras.empty() ? 0 : 1);
        ByteWriter head;
        put_header(head, kHeaderSize + records.bytes.size(), count);
        head.put(records.bytes);
        return std::move(head.bytes);
    }

private:
    void put_header(ByteWriter& to, std::size_t points_at, std::uint32_t records) const {
        constexpr std::uint16_t kWkt = 1U << 4U;  // asked for by formats from 6 on
        // Seconds of the week are told apart from those since 2011-09-14, 10^9 s after GPS began.
        constexpr std::uint16_t kStandardTime = 1;
        constexpr double kWeek = 7 * 86'400;
        const bool is_of_week = times.first >= 0 && times.second <= kWeek;
        constexpr std::uint8_t kCompressed = 1U << 7U;
        to.put_padded("LASF", 4);
        to.put_zeros(2);
        to.put<std::uint16_t>(is_of_week ? kWkt : kWkt | kStandardTime);
        to.put_zeros(16);  // no project
        to.put<std::uint8_t>(1);
        to.put<std::uint8_t>(4);
        to.put_padded("", 32);
        to.put_padded("stipple", 32);
        to.put_zeros(4);  // no date, so that the same cloud has the same bytes
        to.put(static_cast<std::uint16_t>(kHeaderSize));
        to.put(static_cast<std::uint32_t>(points_at));
        to.put(records);
        to.put(static_cast<std::uint8_t>(kCompressed | (has_colors ? 7U : 6U)));
        to.put(static_cast<std::uint16_t>(kLazPointSize + (has_colors ? kLazColorSize : 0) +
                                          fields.extra_size));
        to.put_zeros(24);  // counts of versions before
        to.put(Vec3d::Constant(cube.step).eval());
        to.put(cube.low);
        for (int axis = 0; axis < 3; ++axis) {
            to.put(box.max[axis]);
            to.put(box.min[axis]);
        }
        to.put<std::uint64_t>(0);  // no waveforms
        to.put(hierarchy_record);
        to.put<std::uint32_t>(1);
        to.put(points);
        for (const std::uint64_t count : by_return) to.put(count);
    }
    void put_info(ByteWriter& to) const {
        const double half = cube.side() / 2;
        put_record_head(to, "copc", 1, kInfoSize, "COPC info");
        to.put((cube.low.array() + half).matrix().eval());
        to.put(half);
        to.put(spacing);
        to.put(root_offset);
        to.put(root_size);
        to.put(times.first);
        to.put(times.second);
        to.put_zeros(11 * 8);  // reserved
    }
};

}  // namespace

std::vector<std::byte> encode_copc(const PointCloud& cloud, const CopcOptions& options,
                                   const RunContext& context, std::vector<std::string>* odd) {
    validate(cloud);
    if (options.epsg) well_known_text(*options.epsg);  // refuses systems that it does not know
    if (cloud.empty())
        throw Error(ErrorCode::InvalidArgument, "the cloud has no points: expected at least 1");
    if (!std::ranges::all_of(cloud.positions, [](const Vec3f& p) { return p.allFinite(); }))
        throw Error(ErrorCode::InvalidArgument,
                    "a position is not finite: remove such points (`clean`; jobs and commands do)");
    const LasFields fields(cloud);
    if (odd != nullptr) *odd = fields.odd;
    const SampledOctree octree(cloud, cube_of(cloud, options, context), options.octree,
                               context.part(0, 0.5));
    context.checkpoint(0.5);

    const std::span<const SampledOctree::Node> nodes = octree.nodes();
    std::vector<std::vector<std::byte>> encoded(nodes.size());
    parallel_for_blocks(nodes.size(), 1, context, [&](std::size_t n, std::size_t) {
        encoded[n] = encode_laz_chunk(points_of_node(cloud, fields, octree, nodes[n]));
    });
    context.checkpoint(0.9);

    Head head{.cube = octree.cube(),
              .box = bounds_on_grid(octree),
              .points = cloud.size(),
              .spacing = octree.cube().side() / options.octree.grid,
              .has_colors = !cloud.colors.empty(),
              .by_return = points_by_return(fields, cloud.size()),
              .times = times_of(fields),
              .fields = fields,
              .epsg = options.epsg};
    ByteWriter file;
    file.put_zeros(head.bytes().size() + kTablePointer);
    const std::vector<std::size_t> order = order_of_file(nodes);
    const std::vector<Chunk> chunks =
        append_chunks(file, nodes, order, std::move(encoded), context);
    const std::uint64_t table = file.bytes.size();
    std::vector<LazChunkSize> sizes;
    for (const std::size_t n : order) sizes.push_back(chunks[n].size);
    file.put(encode_laz_chunk_table(sizes));
    head.hierarchy_record = file.bytes.size();
    const Hierarchy hierarchy(nodes, chunks, file.bytes.size() + kExtendedRecordHead);
    head.root_offset = hierarchy.root_offset();
    head.root_size = hierarchy.root_size();
    file.put<std::uint16_t>(0);
    file.put_padded("copc", 16);
    file.put<std::uint16_t>(1000);
    file.put<std::uint64_t>(hierarchy.pages().size());
    file.put_padded("EPT hierarchy", 32);
    file.put(hierarchy.pages());

    const std::vector<std::byte> first = head.bytes();
    std::ranges::copy(first, file.bytes.begin());
    std::memcpy(file.bytes.data() + first.size(), &table, kTablePointer);
    context.checkpoint(1);
    return std::move(file.bytes);
}

}  // namespace stipple
