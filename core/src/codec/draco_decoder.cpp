// Reads Draco through Google's decoder. All that is known without it is checked first; what it
// gives back is checked again, since a hostile file decides it.

#include "base/in_quotes.hpp"
#include "cloud/attribute_name.hpp"
#include "cloud/box_of_most.hpp"
#include "cloud/color_channel.hpp"
#include "cloud/georeference.hpp"
#include "cloud/whole_numbers.hpp"
#include "codec/draco.hpp"
#include "codec/draco_header.hpp"
#include "codec/normal_scale.hpp"
#include "stipple/error.hpp"

#include <draco/compression/decode.h>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <memory>
#include <new>
#include <stdexcept>

namespace stipple {

namespace {

using draco::GeometryAttribute;
using draco::PointAttribute;

void check_points(std::uint64_t points, const DecodeLimits& limits) {
    const std::uint64_t most =
        std::min<std::uint64_t>(limits.max_points, std::numeric_limits<Index>::max());
    if (points > most) {
        throw Error(ErrorCode::TooLarge, "Draco: " + std::to_string(points) +
                                             " points: expected at most " + std::to_string(most) +
                                             "; split the cloud, or raise the limit");
    }
}

/// The geometry: a draco::Mesh when the file holds one.
std::unique_ptr<draco::PointCloud> decode_geometry(std::span<const std::byte> file,
                                                   std::uint64_t max_memory_bytes) {
    draco::DecoderBuffer buffer;
    buffer.Init(reinterpret_cast<const char*>(file.data()), file.size());
    draco::Decoder decoder;
    try {
        auto result = decoder.DecodePointCloudFromBuffer(&buffer);
        if (result.ok()) return std::move(result).value();
        const std::string why = result.status().error_msg_string();
        throw Error(ErrorCode::MalformedInput,
                    "Draco: the decoder refuses the " + std::to_string(file.size()) +
                        " bytes: " + (why.empty() ? "they are truncated or damaged" : why));
    } catch (const std::bad_alloc&) {
        const std::string limit =
            max_memory_bytes == 0 ? "there is"
                                  : "the limit of " + std::to_string(max_memory_bytes) + " bytes";
        throw Error(ErrorCode::TooLarge, "Draco: decoding these " + std::to_string(file.size()) +
                                             " bytes takes more memory than " + limit +
                                             "; the file is damaged, or the cloud too large");
    } catch (const std::length_error&) {
        throw Error(ErrorCode::MalformedInput,
                    "Draco: the file asks for arrays of impossible length");
    }
}

/// A value of the attribute for every point, as `T`; the attribute has values of type `From`.
template <typename From, typename T, typename Convert>
std::vector<T> convert_values(const draco::PointCloud& geometry, const PointAttribute& attribute,
                              Convert&& convert) {
    const std::size_t n = geometry.num_points();
    const unsigned components = attribute.num_components();
    std::vector<T> values(n * components);
    for (std::size_t i = 0; i < n; ++i) {
        const auto index = attribute.mapped_index(draco::PointIndex(static_cast<std::uint32_t>(i)));
        const std::uint8_t* from = attribute.GetAddress(index);
        for (unsigned c = 0; c < components; ++c, from += sizeof(From)) {
            From value;
            std::memcpy(&value, from, sizeof(From));
            values[i * components + c] = convert(value);
        }
    }
    return values;
}

std::size_t bytes_of(draco::DataType type) {
    return static_cast<std::size_t>(draco::DataTypeLength(type));
}

/// Every point must have a value, and every value must be there.
void check_attribute(const draco::PointCloud& geometry, const PointAttribute& attribute) {
    const auto fail = [&](const std::string& what) {
        throw Error(ErrorCode::MalformedInput,
                    "Draco: attribute " + std::to_string(attribute.unique_id()) + ": " + what);
    };
    const draco::DataType type = attribute.data_type();
    if (type <= draco::DT_INVALID || type > draco::DT_BOOL)
        fail("data type " + std::to_string(type) + " is not known");
    if (attribute.num_components() < 1) fail("0 components: expected 1..255");
    const std::size_t value = bytes_of(type) * attribute.num_components();
    const auto stride = static_cast<std::size_t>(attribute.byte_stride());
    const std::size_t have = attribute.buffer() == nullptr ? 0 : attribute.buffer()->data_size();
    if (stride < value) fail("values overlap");
    const std::size_t n = geometry.num_points();
    if (!attribute.is_mapping_identity() && attribute.indices_map_size() < n) {
        fail(std::to_string(attribute.indices_map_size()) + " of " + std::to_string(n) +
             " points have a value");
    }
    std::size_t entries = attribute.is_mapping_identity() ? n : 0;
    for (std::size_t i = 0; i < n && !attribute.is_mapping_identity(); ++i) {
        const auto index = attribute.mapped_index(draco::PointIndex(static_cast<std::uint32_t>(i)));
        entries = std::max<std::size_t>(entries, std::size_t{index.value()} + 1);
    }
    if (entries > have / stride) {
        fail(std::to_string(entries) + " values are referenced, but only " +
             std::to_string(have / stride) + " exist");
    }
}

/// Calls `f.template operator()<From>()` with the type of the values.
template <typename F>
decltype(auto) with_data_type(draco::DataType type, F&& f) {
    switch (type) {
        case draco::DT_INT8:
            return f.template operator()<std::int8_t>();
        case draco::DT_INT16:
            return f.template operator()<std::int16_t>();
        case draco::DT_UINT16:
            return f.template operator()<std::uint16_t>();
        case draco::DT_INT32:
            return f.template operator()<std::int32_t>();
        case draco::DT_UINT32:
            return f.template operator()<std::uint32_t>();
        case draco::DT_INT64:
            return f.template operator()<std::int64_t>();
        case draco::DT_UINT64:
            return f.template operator()<std::uint64_t>();
        case draco::DT_FLOAT32:
            return f.template operator()<float>();
        case draco::DT_FLOAT64:
            return f.template operator()<double>();
        default:
            return f.template operator()<std::uint8_t>();  // bytes and booleans
    }
}

template <typename T>
std::vector<T> read_as(const draco::PointCloud& geometry, const PointAttribute& attribute) {
    return with_data_type(attribute.data_type(), [&]<typename From>() {
        return convert_values<From, T>(geometry, attribute,
                                       [](From v) { return static_cast<T>(v); });
    });
}

std::vector<Vec3f> read_vectors(const draco::PointCloud& geometry,
                                const PointAttribute& attribute) {
    const std::vector<float> flat = read_as<float>(geometry, attribute);
    std::vector<Vec3f> vectors(flat.size() / 3);
    static_assert(sizeof(Vec3f) == 3 * sizeof(float));
    if (!flat.empty()) std::memcpy(vectors[0].data(), flat.data(), flat.size() * sizeof(float));
    return vectors;
}

void read_positions(const draco::PointCloud& geometry, const PointAttribute& attribute,
                    PointCloud& cloud) {
    if (attribute.num_components() != 3) {
        throw Error(ErrorCode::MalformedInput, "Draco: positions of " +
                                                   std::to_string(attribute.num_components()) +
                                                   " components: expected 3");
    }
    const draco::DataType type = attribute.data_type();
    const bool fits_float = type == draco::DT_FLOAT32 || bytes_of(type) <= 2;
    if (fits_float) {
        cloud.positions = read_vectors(geometry, attribute);
        return;
    }
    const std::vector<double> flat = read_as<double>(geometry, attribute);
    const auto coordinate = [&](std::size_t i) {
        return Vec3d(flat[3 * i], flat[3 * i + 1], flat[3 * i + 2]);
    };
    cloud.positions.resize(flat.size() / 3);
    Aabb box;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const Vec3d p = coordinate(i);
        if (!p.allFinite()) continue;
        box.min = box.min.cwiseMin(p);
        box.max = box.max.cwiseMax(p);
    }
    cloud.origin = choose_origin(box, some_of(cloud.size(), coordinate));
    cloud.double_precision = true;
    for (std::size_t i = 0; i < cloud.size(); ++i)
        cloud.positions[i] = (coordinate(i) - cloud.origin).cast<float>();
}

/// As colours of T, 16 bits or floats; the attribute's values are such, or wider.
template <typename T>
void read_wide_colors(const draco::PointCloud& geometry, const PointAttribute& attribute,
                      PointCloud& cloud, DecodeReport& report) {
    const std::vector<T> flat = with_data_type(attribute.data_type(), [&]<typename From>() {
        return convert_values<From, T>(geometry, attribute,
                                       [](From v) { return to_wide_channel<T>(v); });
    });
    const std::size_t step = cloud.has_alpha ? 4 : 3;
    WideColors<T> wide;
    wide.resize(cloud.colors.size());
    for (std::size_t i = 0; i < wide.values.size(); ++i)
        std::copy_n(flat.begin() + static_cast<std::ptrdiff_t>(i * step), step,
                    wide.values[i].begin());
    if (!wide.narrow(cloud.colors)) report.skipped.emplace_back(WideColors<T>::kLost);
}

void read_colors(const draco::PointCloud& geometry, const PointAttribute& attribute,
                 PointCloud& cloud, DecodeReport& report) {
    cloud.has_alpha = attribute.num_components() == 4;
    cloud.colors.resize(geometry.num_points());
    const draco::DataType type = attribute.data_type();
    if (type == draco::DT_FLOAT32 || type == draco::DT_FLOAT64)
        return read_wide_colors<float>(geometry, attribute, cloud, report);
    if (bytes_of(type) > 1)
        return read_wide_colors<std::uint16_t>(geometry, attribute, cloud, report);
    const std::vector<std::uint8_t> flat = with_data_type(type, [&]<typename From>() {
        return convert_values<From, std::uint8_t>(geometry, attribute,
                                                  [](From v) { return to_channel(v); });
    });
    const std::size_t step = cloud.has_alpha ? 4 : 3;
    for (std::size_t i = 0; i < cloud.colors.size(); ++i) {
        const std::uint8_t* const c = flat.data() + i * step;
        cloud.colors[i] = {c[0], c[1], c[2], cloud.has_alpha ? c[3] : std::uint8_t{255}};
    }
}

/// From the metadata (`name`, which the tools of Draco and PDAL write too), else by what it is.
std::string name_of(const draco::PointCloud& geometry, int id) {
    const PointAttribute& attribute = *geometry.attribute(id);
    const draco::AttributeMetadata* const metadata = geometry.GetAttributeMetadataByAttributeId(id);
    std::string name;
    if (metadata != nullptr && metadata->GetEntryString("name", &name) &&
        !attribute_name_of(name).empty())
        return name;
    return attribute.attribute_type() == GeometryAttribute::TEX_COORD
               ? "texcoord"
               : "generic_" + std::to_string(attribute.unique_id());
}

/// Doubles that the encoder wrote for integers, as these.
template <typename T>
std::vector<T> narrowed(const std::vector<double>& values) {
    std::vector<T> result(values.size());
    std::ranges::transform(values, result.begin(), [](double v) {
        constexpr double kLow = std::numeric_limits<T>::min();
        constexpr double kHigh = std::numeric_limits<T>::max();
        return v >= kLow && v <= kHigh ? static_cast<T>(v) : T{0};
    });
    return result;
}

/// The type that an attribute had before the encoder gave it another; empty for all others.
std::string original_type(const draco::PointCloud& geometry, int id) {
    const auto* const metadata = geometry.GetAttributeMetadataByAttributeId(id);
    std::string type;
    if (metadata != nullptr) metadata->GetEntryString("stipple.type", &type);
    return type;
}

/// @param rounded  set where a value is not kept as it is.
AttributeValues read_values(const draco::PointCloud& geometry, int id, bool& rounded) {
    const PointAttribute& attribute = *geometry.attribute(id);
    if (attribute.data_type() == draco::DT_FLOAT64) {
        const std::string type = original_type(geometry, id);
        if (type == "int32") return narrowed<std::int32_t>(read_as<double>(geometry, attribute));
        if (type == "uint32") return narrowed<std::uint32_t>(read_as<double>(geometry, attribute));
    }
    if (attribute.data_type() == draco::DT_INT32 && original_type(geometry, id) == "float32")
        return read_as<float>(geometry, attribute);
    return with_data_type(attribute.data_type(), [&]<typename From>() -> AttributeValues {
        // There is no attribute of 64-bit integers: a double holds them up to 2^53.
        using T = std::conditional_t<std::is_integral_v<From> && sizeof(From) == 8, double, From>;
        return convert_values<From, T>(geometry, attribute, [&rounded](From v) {
            if constexpr (std::is_integral_v<From>) rounded = rounded || !fits_double(v);
            return static_cast<T>(v);
        });
    });
}

void read_attribute(const draco::PointCloud& geometry, int id, PointCloud& cloud,
                    DecodeReport& report) {
    bool rounded = false;
    AttributeValues values = read_values(geometry, id, rounded);
    std::string name = name_of(geometry, id);
    if (rounded) report.skipped.push_back(digits_lost_of(name));
    const Reduction reduction = reduction_of(name, values);
    cloud.attributes.push_back({std::move(name), std::move(values),
                                static_cast<unsigned>(geometry.attribute(id)->num_components()),
                                reduction});
}

void read_origin(const draco::PointCloud& geometry, PointCloud& cloud) {
    std::vector<double> origin;
    const draco::GeometryMetadata* const metadata = geometry.GetMetadata();
    if (metadata == nullptr || !metadata->GetEntryDoubleArray("stipple.origin", &origin)) return;
    if (origin.size() != 3 ||
        !std::ranges::all_of(origin, [](double v) { return std::isfinite(v); })) {
        throw Error(ErrorCode::MalformedInput,
                    "Draco: metadata stipple.origin: expected 3 finite numbers");
    }
    cloud.origin += Vec3d(origin[0], origin[1], origin[2]);
    cloud.double_precision = true;
}

}  // namespace

PointCloud decode_draco(std::span<const std::byte> file, const DecodeLimits& limits,
                        const RunContext& context, DecodeReport& report) {
    const DracoHeader header = parse_draco_header(file);
    if (header.declared_points) check_points(*header.declared_points, limits);
    const std::unique_ptr<draco::PointCloud> geometry =
        decode_geometry(file, limits.max_memory_bytes);
    context.checkpoint(0.7);
    check_points(geometry->num_points(), limits);

    const int positions = geometry->GetNamedAttributeId(GeometryAttribute::POSITION);
    const int normals = geometry->GetNamedAttributeId(GeometryAttribute::NORMAL);
    const int colors = geometry->GetNamedAttributeId(GeometryAttribute::COLOR);
    if (positions < 0) throw Error(ErrorCode::MalformedInput, "Draco: no position attribute");
    if (std::cmp_greater(geometry->num_attributes(), limits.max_attributes + 3ULL)) {
        throw Error(ErrorCode::TooLarge, "Draco: " + std::to_string(geometry->num_attributes()) +
                                             " attributes: expected at most " +
                                             std::to_string(limits.max_attributes) +
                                             " besides position, normal and colour");
    }

    PointCloud cloud;
    for (int id = 0; id < geometry->num_attributes(); ++id) {
        const PointAttribute& attribute = *geometry->attribute(id);
        check_attribute(*geometry, attribute);
        const unsigned components = attribute.num_components();
        if (id == positions) {
            read_positions(*geometry, attribute, cloud);
        } else if (id == normals && components == 3) {
            cloud.normals = read_vectors(*geometry, attribute);
            const float scale = with_data_type(attribute.data_type(), normal_scale);
            for (Vec3f& normal : cloud.normals) normal *= scale;
        } else if (id == colors && (components == 3 || components == 4)) {
            read_colors(*geometry, attribute, cloud, report);
        } else {
            read_attribute(*geometry, id, cloud, report);
        }
        context.checkpoint(0.7 + 0.3 * (id + 1) / geometry->num_attributes());
    }
    read_origin(*geometry, cloud);
    std::ranges::move(settle_names(cloud), std::back_inserter(report.skipped));

    report.encoding = header.encoding;
    report.points = geometry->num_points();
    if (const auto* const mesh = dynamic_cast<const draco::Mesh*>(geometry.get())) {
        report.faces = mesh->num_faces();
        if (report.faces != 0) report.skipped.emplace_back("face");
    }
    return cloud;
}

}  // namespace stipple
