// Writes Draco through Google's encoder, which is told everything: its builder would remove
// duplicates, and its defaults reorder points and quantise without a bound. Types it cannot hold
// are widened, and the metadata says what they were.

#include "base/in_quotes.hpp"
#include "base/parallel_for.hpp"
#include "base/random.hpp"
#include "base/refuse.hpp"
#include "cloud/attribute_name.hpp"
#include "cloud/box_of_most.hpp"
#include "cloud/chain_order.hpp"
#include "cloud/directions.hpp"
#include "cloud/grid_step.hpp"
#include "cloud/whole_numbers.hpp"
#include "neighbors/gaps.hpp"
#include "neighbors/point_tree.hpp"
#include "stipple/codec.hpp"
#include "stipple/error.hpp"

#include <draco/compression/expert_encode.h>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <memory>

namespace stipple {

namespace {

using draco::GeometryAttribute;

constexpr unsigned kMostBits = 30;
constexpr int kMostCodedBits = 26;  // Draco's table of symbols for more takes a gigabyte and above:
                                    // they are stored in whole bytes

void check_range(const char* name, unsigned value, unsigned least, unsigned most,
                 bool zero_allowed) {
    if ((value >= least && value <= most) || (zero_allowed && value == 0)) return;
    refuse(name, ' ', value, ": expected ", least, "..", most,
           zero_allowed ? ", or 0 for unquantised" : "");
}

void check(const DracoEncodeOptions& options) {
    check_range("position_bits", options.position_bits, 1, kMostBits, true);
    check_range("normal_bits", options.normal_bits, 2, kMostBits, false);
    check_range("attribute_bits", options.attribute_bits, 1, kMostBits, true);
    check_range("compression_level", options.compression_level, 0, 10, false);
}

bool are_finite(std::span<const Vec3f> vectors) {
    return std::ranges::all_of(vectors, [](const Vec3f& v) { return v.allFinite(); });
}

template <typename Vectors>
void require_finite(const Vectors& vectors, const char* what, const char* remedy) {
    const auto found = std::ranges::find_if(vectors, [](const Vec3f& v) { return !v.allFinite(); });
    if (found == vectors.end()) return;
    refuse(what, " of point ", found - vectors.begin(),
           " is not finite, which Draco cannot quantise: ", remedy);
}

/// The longest side of the box of the positions, and the largest coordinate: what the error of a
/// quantisation depends on.
struct Extent {
    double side = 0;
    double largest = 0;
    Vec3f low = Vec3f::Zero();  ///< of the box
};

Extent extent_of(std::span<const Vec3f> positions) {
    if (positions.empty()) return {};
    Vec3f low = positions[0];
    Vec3f high = positions[0];
    for (const Vec3f& p : positions) {
        low = low.cwiseMin(p);
        high = high.cwiseMax(p);
    }
    const double side = (high.cast<double>() - low.cast<double>()).maxCoeff();
    if (side > double{std::numeric_limits<float>::max()})
        refuse("the positions exceed the range of single precision");
    return {side, std::max(low.cwiseAbs().maxCoeff(), high.cwiseAbs().maxCoeff()), low};
}

/// Whether Draco's arithmetic, in floats, has a step of so many bits, and how many of them there
/// are to the unit.
bool has_step(double range, unsigned bits) {
    const double steps = std::exp2(bits) - 1;
    return range == 0 || (range / steps >= double{std::numeric_limits<float>::min()} &&
                          steps / range <= double{std::numeric_limits<float>::max()});
}

/// The fewest bits whose error per axis is at most `precision`. The largest error is half a step,
/// side / (2^bits - 1) / 2, and what the decoder's single-precision arithmetic adds: it rounds
/// three times, numbers up to the side or the largest coordinate.
/// @param read  by how much reading has rounded them.
unsigned bits_for(double precision, const Extent& extent, double read) {
    require(makes_steps(precision), "precision", precision, "a finite number above 0");
    const double rounding = read + rounding_of_floats(3 * extent.side + extent.largest);
    const double levels = extent.side / (2 * (precision - rounding)) + 1;
    const double bits = extent.side == 0 ? 1 : std::ceil(std::log2(levels));
    if (precision <= rounding || bits > kMostBits) {
        refuse("precision ", precision, ": expected at least ",
               std::max(2 * rounding, extent.side * 0x1p-30), " for points ", extent.side,
               " apart in single precision; position_bits 0 keeps them exactly");
    }
    return std::max(1U, static_cast<unsigned>(bits));
}

/// Whether a grid leaves points that are spread over all of a cloud few places: fewer than half as
/// many as a curve through its box would have.
bool crowds(std::span<const Vec3d> some, double side, unsigned bits) {
    if (some.size() < 2) return false;
    Vec3d low = some.front();
    for (const Vec3d& p : some) low = low.cwiseMin(p);
    const double last = std::exp2(bits) - 1;
    std::vector<std::array<double, 3>> places;
    for (const Vec3d& p : some) {
        const Vec3d at = ((p - low) * (last / side)).array().round();
        places.push_back({at.x(), at.y(), at.z()});
    }
    std::ranges::sort(places);
    const auto repeated = std::ranges::unique(places);
    const double distinct = static_cast<double>(places.size() - repeated.size());
    return 2 * distinct < std::min(static_cast<double>(some.size()), last + 1);
}

/// Whether fewer places of a grid have points, by a tenth, than the cloud has points in different
/// places: by some of the grid's places.
bool merges(std::span<const Vec3f> positions, const Extent& extent, unsigned bits,
            const RunContext& context) {
    constexpr std::size_t kAsked = 8'192;
    constexpr double kFewer = 0.9;
    const auto steps = static_cast<float>((std::exp2(bits) - 1) / extent.side);
    const std::uint64_t part = positions.size() / kAsked + 1;
    std::vector<std::uint64_t> places, points;  // by hashes
    for_blocks_in_order(positions.size(), context, [&](std::size_t begin, std::size_t end) {
        for (const Vec3f& p : positions.subspan(begin, end - begin)) {
            std::uint64_t place = 0, point = 0;
            for (int axis = 0; axis < 3; ++axis) {
                const float at = std::round((p[axis] - extent.low[axis]) * steps);
                place = random_bits(place, static_cast<std::uint64_t>(at));
            }
            if (below(place, part) != 0) continue;
            for (const float x : p) point = random_bits(point, std::bit_cast<std::uint32_t>(x));
            places.push_back(place);
            points.push_back(point);
        }
    });
    const auto distinct = [](std::vector<std::uint64_t>& hashes) {
        std::ranges::sort(hashes);
        return static_cast<double>(hashes.size() - std::ranges::unique(hashes).size());
    };
    return distinct(places) < kFewer * distinct(points);
}

/// A few points far off, or parts far apart, would leave the others a few steps of the grid: then
/// the bits are those of the box about most points, and of steps no longer than the spacing, as
/// they are where many points of a long and narrow cloud would fall together (who asks for fewer
/// bits than the usual ones wants them to). 0, exact floats, where the decoder's single precision
/// would not hold so many.
unsigned bits_for_most(std::span<const Vec3f> positions, const Extent& extent,
                       const DracoEncodeOptions& options, const RunContext& context) {
    constexpr unsigned kMostOfFloat = 22;
    constexpr unsigned kUsualBits = DracoEncodeOptions{}.position_bits;
    const std::vector<Vec3d> some = some_of(
        positions.size(), [&](std::size_t i) { return Vec3d(positions[i].cast<double>()); });
    const double most = longest_side(box_of_most(some));
    if (!(most > 0)) return options.position_bits;
    unsigned bits = options.position_bits;
    if (extent.side > kFarOffGrid * most) {
        bits += static_cast<unsigned>(std::ceil(std::log2(extent.side / most)));
    } else if (crowds(some, extent.side, bits) ||
               (bits >= kUsualBits && merges(positions, extent, bits, context))) {
        const double spacing = median_gap(PointTree(positions, PointTree::Leaves::Loose, context));
        if (spacing > 0)
            bits = std::max(bits,
                            static_cast<unsigned>(std::ceil(std::log2(extent.side / spacing + 1))));
    }
    if (bits <= std::max(kMostOfFloat, options.position_bits)) return bits;
    return options.coding == DracoCoding::KdTree ? std::min(bits, kMostBits) : 0;
}

// ---- The cloud as Draco holds it

struct Encoded {
    draco::PointCloud geometry;
    std::vector<int> quantization_bits;  ///< of each attribute; 0: as it is
};

constexpr std::uint32_t kFirstGenericId = 3;

/// How the values of an attribute lie in memory, and what they are.
struct Values {
    const void* data;
    std::size_t stride;  ///< bytes from a point's to the next's; may be more than are taken
    unsigned components;
    draco::DataType type;
};

/// Takes the attributes of a cloud over, in an order.
class Handover {
public:
    /// @param order  of all points; empty: as they stand.
    Handover(std::size_t points, std::span<const Index> order, Encoded& to,
             const RunContext& context)
        : order_(order), to_(to), context_(context) {
        to_.geometry.set_num_points(static_cast<std::uint32_t>(points));
    }

    int add(GeometryAttribute::Type type, std::uint32_t unique_id, const Values& values,
            int quantization_bits) {
        const std::size_t bytes =
            values.components * static_cast<std::size_t>(draco::DataTypeLength(values.type));
        const bool normalized = type == GeometryAttribute::COLOR;
        GeometryAttribute attribute;
        attribute.Init(type, nullptr, static_cast<std::uint8_t>(values.components), values.type,
                       normalized, static_cast<std::int64_t>(bytes), 0);
        const std::uint32_t n = to_.geometry.num_points();
        const int id = to_.geometry.AddAttribute(attribute, true, n);
        draco::PointAttribute& added = *to_.geometry.attribute(id);
        added.set_unique_id(unique_id);
        if (n != 0) copy(values, bytes, added.buffer()->data());
        to_.quantization_bits.push_back(quantization_bits);
        return id;
    }

    draco::PointCloud& geometry() noexcept { return to_.geometry; }

private:
    void copy(const Values& values, std::size_t bytes, std::uint8_t* to) const {
        constexpr std::size_t kBlock = 65'536;
        const auto* const from = static_cast<const std::byte*>(values.data);
        parallel_for_blocks(
            to_.geometry.num_points(), kBlock, context_, [&](std::size_t begin, std::size_t end) {
                for (std::size_t i = begin; i < end; ++i) {
                    const std::size_t point = order_.empty() ? i : order_[i];
                    std::memcpy(to + i * bytes, from + point * values.stride, bytes);
                }
            });
    }

    std::span<const Index> order_;
    Encoded& to_;
    const RunContext& context_;
};

/// The memory of what was handed over, if the cloud may be spent.
template <typename Vector>
void give_back(Vector& values) {
    if constexpr (!std::is_const_v<Vector>) Vector().swap(values);
}

template <typename T>
constexpr draco::DataType data_type_of() {
    if constexpr (std::is_same_v<T, std::int8_t>) return draco::DT_INT8;
    if constexpr (std::is_same_v<T, std::uint8_t>) return draco::DT_UINT8;
    if constexpr (std::is_same_v<T, std::int16_t>) return draco::DT_INT16;
    if constexpr (std::is_same_v<T, std::uint16_t>) return draco::DT_UINT16;
    if constexpr (std::is_same_v<T, std::int32_t>) return draco::DT_INT32;
    if constexpr (std::is_same_v<T, std::uint32_t>) return draco::DT_UINT32;
    if constexpr (std::is_same_v<T, float>) return draco::DT_FLOAT32;
    return draco::DT_FLOAT64;
}

/// Draco refuses to quantise what is not finite or spreads beyond a float, and makes something else
/// of what spreads too little; such values stay as they are.
bool can_be_quantized(const std::vector<float>& values, unsigned bits) {
    if (values.empty()) return false;
    const auto [low, high] = std::ranges::minmax(values);
    return std::ranges::all_of(values, [](float v) { return std::isfinite(v); }) &&
           std::isfinite(high - low) && has_step(double{high} - double{low}, bits);
}

/// Draco takes integers through int32, predicts them up to the range of all beyond both ends, and
/// its encoder keeps a table as long as the largest difference: from 2^31 on it crashes, and below
/// it takes gigabytes. What spreads wider than this, or lies so near the ends of int32, goes as
/// doubles, which any reader understands.
template <typename T>
bool can_be_entropy_coded(const std::vector<T>& values) {
    constexpr std::int64_t kWidest = std::int64_t{1} << 24;
    if (values.empty()) return true;
    const auto [low, high] = std::ranges::minmax(values);
    const std::int64_t range = std::int64_t{high} - std::int64_t{low};
    using Int32 = std::numeric_limits<std::int32_t>;
    return range < kWidest && std::int64_t{high} + range < Int32::max() &&
           std::int64_t{low} - range > Int32::min();
}

/// Whole numbers as integers, where Draco holds them.
std::optional<std::vector<std::int32_t>> as_integers(const std::vector<float>& values) {
    constexpr float kBeyond = 2'147'483'648.0F;  // 2^31
    if (!std::ranges::all_of(values, [](float v) { return std::abs(v) < kBeyond; })) return {};
    std::vector<std::int32_t> integers(values.begin(), values.end());
    if (!can_be_entropy_coded(integers)) return {};
    return integers;
}

template <typename OneAttribute>
void add_generic(OneAttribute& attribute, std::uint32_t unique_id, unsigned attribute_bits,
                 Handover& handover) {
    std::string original_type;
    const int id = std::visit(
        [&]<typename Vector>(Vector& values) {
            using T = typename Vector::value_type;
            const unsigned components = attribute.components;
            const auto add = [&](draco::DataType type, const auto& from, int bits) {
                const std::size_t stride = components * sizeof(from[0]);
                return handover.add(GeometryAttribute::GENERIC, unique_id,
                                    {from.data(), stride, components, type}, bits);
            };
            if constexpr (std::is_integral_v<T> && sizeof(T) == 4) {
                if (!can_be_entropy_coded(values)) {
                    original_type = std::is_signed_v<T> ? "int32" : "uint32";
                    const std::vector<double> wide(values.begin(), values.end());
                    give_back(values);
                    return add(draco::DT_FLOAT64, wide, 0);
                }
            }
            int bits = 0;
            if constexpr (std::is_same_v<T, float>) {
                if (!are_whole(values)) {
                    if (can_be_quantized(values, attribute_bits))
                        bits = static_cast<int>(attribute_bits);
                } else if (const auto integers = as_integers(values)) {
                    original_type = "float32";
                    give_back(values);
                    return add(draco::DT_INT32, *integers, 0);
                }
            }
            const int added = add(data_type_of<T>(), values, bits);
            give_back(values);
            return added;
        },
        attribute.values);

    auto metadata = std::make_unique<draco::AttributeMetadata>();
    metadata->AddEntryString("name", attribute.name);
    if (!original_type.empty()) metadata->AddEntryString("stipple.type", original_type);
    handover.geometry().AddAttributeMetadata(id, std::move(metadata));
}

void check_attribute(const Attribute& attribute) {
    if (!is_attribute_name(attribute.name)) {
        refuse("attribute ", in_quotes(attribute.name), ": expected a name of ",
               kAttributeNameRule);
    }
    constexpr unsigned kMostComponents = 127;  // what the decoder's signed byte holds
    if (attribute.components < 1 || attribute.components > kMostComponents) {
        refuse("attribute ", attribute.name, " has ", attribute.components,
               " components: Draco holds 1..", kMostComponents);
    }
}

/// @param cloud  is spent unless it is const.
template <typename Cloud>
void fill(Cloud& cloud, std::span<const Index> order, const DracoEncodeOptions& options,
          unsigned position_bits, Encoded& encoded, const RunContext& context) {
    const bool empty = cloud.empty();
    Handover handover(cloud.size(), order, encoded, context);
    const auto add_vectors = [&](GeometryAttribute::Type type, std::uint32_t unique_id,
                                 auto& vectors, unsigned bits) {
        handover.add(type, unique_id, {vectors.data(), sizeof(Vec3f), 3, draco::DT_FLOAT32},
                     static_cast<int>(bits));
        give_back(vectors);
    };
    add_vectors(GeometryAttribute::POSITION, 0, cloud.positions, position_bits);
    if (have_directions(cloud.normals))
        add_vectors(GeometryAttribute::NORMAL, 1, cloud.normals, options.normal_bits);
    if (!cloud.colors.empty()) {
        static_assert(offsetof(Rgba8, a) == 3, "colours without alpha are the first three bytes");
        const unsigned channels = cloud.has_alpha ? 4 : 3;
        handover.add(GeometryAttribute::COLOR, 2,
                     {cloud.colors.data(), sizeof(Rgba8), channels, draco::DT_UINT8}, 0);
        give_back(cloud.colors);
    }
    std::uint32_t unique_id = kFirstGenericId;
    // Draco's decoder refuses integers of no points: an empty cloud is its positions and origin.
    for (auto& attribute : std::span(cloud.attributes).first(empty ? 0 : cloud.attributes.size())) {
        check_attribute(attribute);
        add_generic(attribute, unique_id++, options.attribute_bits, handover);
    }
    if (cloud.double_precision || !cloud.origin.isZero(0)) {
        if (encoded.geometry.GetMetadata() == nullptr) {
            encoded.geometry.AddMetadata(std::make_unique<draco::GeometryMetadata>());
        }
        encoded.geometry.metadata()->AddEntryDoubleArray(
            "stipple.origin", {cloud.origin.x(), cloud.origin.y(), cloud.origin.z()});
    }
}

// ---- The coding

/// Why the kd-tree coding cannot hold the cloud; empty when it can.
std::string hindrance_to_kd_tree(const Encoded& encoded) {
    if (encoded.geometry.num_points() == 0) return "there are no points";
    for (int id = 0; id < encoded.geometry.num_attributes(); ++id) {
        const draco::PointAttribute& attribute = *encoded.geometry.attribute(id);
        const auto* const metadata = encoded.geometry.GetAttributeMetadataByAttributeId(id);
        std::string name, original_type;
        if (metadata != nullptr) {
            metadata->GetEntryString("name", &name);
            metadata->GetEntryString("stipple.type", &original_type);
        }
        const std::string which = name.empty() ? "the cloud" : "attribute " + in_quotes(name);
        if (attribute.data_type() == draco::DT_FLOAT64) {
            return which +
                   (original_type.empty() ? " has doubles" : " has integers of too wide a range");
        }
        if (attribute.data_type() == draco::DT_FLOAT32 &&
            encoded.quantization_bits[static_cast<std::size_t>(id)] == 0) {
            return which + " has unquantised floats";
        }
    }
    return "";
}

draco::PointCloudEncodingMethod method_for(const Encoded& encoded, DracoCoding coding) {
    const std::string hindrance = hindrance_to_kd_tree(encoded);
    if (coding == DracoCoding::KdTree && !hindrance.empty()) {
        refuse("kd-tree coding: ", hindrance, ", which it cannot hold; use sequential coding");
    }
    const bool bare = encoded.geometry.num_attributes() == 1;
    const bool kd_tree =
        coding == DracoCoding::KdTree || (coding == DracoCoding::Auto && bare && hindrance.empty());
    return kd_tree ? draco::POINT_CLOUD_KD_TREE_ENCODING : draco::POINT_CLOUD_SEQUENTIAL_ENCODING;
}

/// In which differences from one point to the next take few bits.
/// @param step  of the grid; 0: none, floats as they are, which have no differences that count.
std::vector<Index> order_of(const PointCloud& cloud, double step, const RunContext& context) {
    return cloud.colors.empty() || step == 0
               ? chain_through(cloud.positions, context)
               : chain_through(cloud.positions, step, cloud.colors, context);
}

/// @param cloud  is spent unless it is const.
template <typename Cloud>
std::vector<std::byte> encode(Cloud& cloud, const DracoEncodeOptions& options,
                              const RunContext& context, double* told_step) {
    check(options);
    validate(cloud);
    if (options.position_bits != 0 || options.precision)
        require_finite(cloud.positions, "the position",
                       "remove such points (`clean`; jobs and commands do)");
    require_finite(cloud.normals, "the normal", "make such normals zero (`clean` does)");
    unsigned position_bits = options.position_bits;
    double step = 0;
    if (position_bits != 0 || options.precision) {
        const Extent extent = extent_of(cloud.positions);
        position_bits = options.precision
                            ? bits_for(*options.precision, extent, rounding_of_reading(cloud))
                            : bits_for_most(cloud.positions, extent, options, context);
        if (!has_step(extent.side, position_bits))
            refuse("the positions are only ", extent.side, " apart, too little for ", position_bits,
                   " bits in Draco's arithmetic; position_bits 0 keeps them exactly");
        if (position_bits != 0) step = extent.side / (std::exp2(position_bits) - 1);
    }
    if (told_step != nullptr) *told_step = step;
    if (cloud.empty()) position_bits = 0;
    context.checkpoint(0);

    Encoded encoded;
    {
        const bool bare =
            !have_directions(cloud.normals) && cloud.colors.empty() && cloud.attributes.empty();
        std::vector<Index> order;
        if (options.coding == DracoCoding::Auto && !bare && are_finite(cloud.positions))
            order = order_of(cloud, step, context);
        fill(cloud, order, options, position_bits, encoded, context);
    }
    draco::ExpertEncoder encoder(encoded.geometry);
    encoder.SetEncodingMethod(method_for(encoded, options.coding));
    const int speed = 10 - static_cast<int>(options.compression_level);
    encoder.SetSpeedOptions(speed, speed);
    for (int id = 0; id < encoded.geometry.num_attributes(); ++id) {
        const int bits = encoded.quantization_bits[static_cast<std::size_t>(id)];
        if (bits != 0) encoder.SetAttributeQuantization(id, bits);
    }
    if (std::ranges::max(encoded.quantization_bits) > kMostCodedBits)
        encoder.SetUseBuiltInAttributeCompression(false);
    context.checkpoint(0.2);
    draco::EncoderBuffer buffer;
    if (const draco::Status status = encoder.EncodeToBuffer(&buffer); !status.ok()) {
        throw Error(ErrorCode::Internal,
                    "Draco cannot encode the cloud: " + status.error_msg_string());
    }
    context.checkpoint(1);
    const auto* const data = reinterpret_cast<const std::byte*>(buffer.data());
    return {data, data + buffer.size()};
}

}  // namespace

std::vector<std::byte> encode_draco(const PointCloud& cloud, const DracoEncodeOptions& options,
                                    const RunContext& context, double* step) {
    return encode(cloud, options, context, step);
}

std::vector<std::byte> encode_draco(PointCloud&& cloud, const DracoEncodeOptions& options,
                                    const RunContext& context, double* step) {
    return encode(cloud, options, context, step);
}

}  // namespace stipple
