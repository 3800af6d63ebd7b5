#include "stipple/proto/tiles.hpp"

#include "json_reader.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

// Follows: Khronos, glTF 2.0 (binary container, §4.4), EXT_meshopt_compression,
// KHR_mesh_quantization, KHR_materials_unlit, EXT_structural_metadata.

namespace stipple::proto {

namespace {

constexpr std::uint32_t kMagic = 0x46546C67, kVersion = 2, kJsonChunk = 0x4E4F534A,
                        kBinaryChunk = 0x004E4942;
constexpr const char* kMeshopt = "EXT_meshopt_compression";
constexpr const char* kMetadata = "EXT_structural_metadata";
constexpr unsigned kPoints = 0, kArrayBuffer = 34962;

std::size_t padded(std::size_t bytes) {
    return (bytes + 3) / 4 * 4;
}

void put(std::vector<std::byte>& to, std::uint32_t value) {
    static_assert(std::endian::native == std::endian::little);
    const auto* const bytes = reinterpret_cast<const std::byte*>(&value);
    to.insert(to.end(), bytes, bytes + sizeof value);
}

void put_chunk(std::vector<std::byte>& to, std::uint32_t type, std::span<const std::byte> bytes,
               std::byte filler) {
    put(to, static_cast<std::uint32_t>(padded(bytes.size())));
    put(to, type);
    to.insert(to.end(), bytes.begin(), bytes.end());
    to.resize(padded(to.size()), filler);
}

std::string shape_of(unsigned components) {
    return components == 1 ? "SCALAR" : "VEC" + std::to_string(components);
}

/// Column by column: (x, y, z) of the grid at (x, z, -y), which 3D Tiles turn to (x, y, z).
Json matrix_of(const LodTile& tile) {
    const double s = tile.step;
    const Vec3d& o = tile.offset;
    return {s, 0., 0., 0., 0., 0., -s, 0., 0., s, 0., 0., o.x(), o.z(), -o.y(), 1.};
}

Json accessor_json(const TileStream& stream, const LodTile& tile, std::size_t view) {
    Json json = {{"bufferView", view},
                 {"componentType", static_cast<unsigned>(stream.type)},
                 {"count", tile.points},
                 {"type", shape_of(stream.components)}};
    if (stream.normalized) json["normalized"] = true;
    if (stream.name == "POSITION") {
        json["min"] = {0, 0, 0};
        json["max"] = tile.last;
    }
    return json;
}

/// A view of the buffer that a decoder fills from compressed bytes of the other.
Json view_json(const TileStream& stream, const LodTile& tile, std::size_t decoded_at,
               std::size_t at) {
    Json packed = {{"buffer", 0},
                   {"byteOffset", at},
                   {"byteLength", stream.bytes.size()},
                   {"byteStride", stream.stride},
                   {"count", tile.points},
                   {"mode", "ATTRIBUTES"}};
    if (stream.octahedral) packed["filter"] = "OCTAHEDRAL";
    return {{"buffer", 1},
            {"byteOffset", decoded_at},
            {"byteLength", tile.points * stream.stride},
            {"byteStride", stream.stride},
            {"target", kArrayBuffer},
            {"extensions", {{kMeshopt, packed}}}};
}

/// The same for each component.
template <typename T>
Json of_each(T value, const TileStream& stream) {
    return stream.components == 1 ? Json(value) : Json(std::vector<T>(stream.components, value));
}

/// What stands for values that are not finite, of the attributes that have some, and what was taken
/// off the others. A name of a property is an identifier, which that of an attribute need not be.
Json metadata_json(const LodTile& tile) {
    Json described, places;
    for (const TileStream& stream : tile.streams) {
        if (!stream.has_no_data && stream.offset == 0) continue;
        const std::string id = "p" + std::to_string(described.size());
        Json& property = described[id] = {{"name", stream.name.substr(1)},
                                          {"type", shape_of(stream.components)},
                                          {"componentType", "FLOAT32"}};
        if (stream.offset != 0) property["offset"] = of_each(stream.offset, stream);
        if (stream.has_no_data) property["noData"] = of_each(TileStream::kNoData, stream);
        places[id] = {{"attribute", stream.name}};
    }
    if (described.empty()) return {};
    return {{"schema", {{"id", "stipple"}, {"classes", {{"point", {{"properties", described}}}}}}},
            {"propertyAttributes", {{{"class", "point"}, {"properties", places}}}}};
}

[[noreturn]] void refuse(const std::string& what) {
    throw Error(ErrorCode::MalformedInput, "glb: " + what);
}

struct Chunks {
    std::string_view json;
    std::span<const std::byte> binary;
};

Chunks chunks_of(std::span<const std::byte> bytes) {
    const auto word = [&](std::size_t at) {
        std::uint32_t value = 0;
        if (at + sizeof value > bytes.size()) refuse("it ends early");
        std::memcpy(&value, bytes.data() + at, sizeof value);
        return std::size_t{value};
    };
    if (word(0) != kMagic || word(4) != kVersion || word(8) != bytes.size())
        refuse("expected version 2, and the length of the file");
    const std::size_t json = word(12);
    if (word(16) != kJsonChunk || json > bytes.size()) refuse("expected a JSON chunk first");
    const std::size_t binary = word(20 + json);
    if (word(24 + json) != kBinaryChunk || 28 + json + binary != bytes.size())
        refuse("expected a binary chunk second, and no more");
    return {{reinterpret_cast<const char*>(bytes.data()) + 20, json},
            bytes.subspan(28 + json, binary)};
}

unsigned components_of(const std::string& shape) {
    for (unsigned n = 1; n <= 4; ++n)
        if (shape == shape_of(n)) return n;
    refuse("accessor type " + shape);
}

TileStream read_stream(const nlohmann::json& root, const std::string& name, std::size_t accessor,
                       std::span<const std::byte> binary) {
    const auto& a = root.at("accessors").at(accessor);
    const auto& packed = root.at("bufferViews")
                             .at(a.at("bufferView").get<std::size_t>())
                             .at("extensions")
                             .at(kMeshopt);
    TileStream stream{.name = name,
                      .type = a.at("componentType").get<TileStream::Type>(),
                      .components = components_of(a.at("type")),
                      .normalized = a.value("normalized", false),
                      .stride = packed.at("byteStride"),
                      .octahedral = packed.value("filter", "") == "OCTAHEDRAL"};
    const std::size_t at = packed.at("byteOffset"), length = packed.at("byteLength");
    if (at > binary.size() || length > binary.size() - at) refuse(name + " beyond its buffer");
    stream.bytes.assign(binary.begin() + static_cast<std::ptrdiff_t>(at),
                        binary.begin() + static_cast<std::ptrdiff_t>(at + length));
    return stream;
}

/// What the metadata say of an attribute.
nlohmann::json property_of(const nlohmann::json& root, const std::string& name) {
    const nlohmann::json::json_pointer metadata("/extensions/" + std::string(kMetadata));
    if (!root.contains(metadata)) return nlohmann::json::object();
    const auto& places = root.at(metadata).at("propertyAttributes").at(0).at("properties");
    for (const auto& [id, place] : places.items()) {
        if (place.at("attribute") != name) continue;
        return root.at(metadata).at("schema").at("classes").at("point").at("properties").at(id);
    }
    return nlohmann::json::object();
}

}  // namespace

std::vector<std::byte> encode_glb(const LodTile& tile) {
    Json attributes, accessors = Json::array(), views = Json::array();
    std::vector<std::byte> binary;
    std::size_t decoded = 0;
    for (const TileStream& stream : tile.streams) {
        attributes[stream.name] = accessors.size();
        accessors.push_back(accessor_json(stream, tile, views.size()));
        views.push_back(view_json(stream, tile, decoded, binary.size()));
        decoded += tile.points * stream.stride;
        binary.insert(binary.end(), stream.bytes.begin(), stream.bytes.end());
        binary.resize(padded(binary.size()));
    }
    Json json = {
        {"asset", {{"version", "2.0"}, {"generator", "stipple"}}},
        {"extensionsUsed", {kMeshopt, "KHR_materials_unlit", "KHR_mesh_quantization"}},
        {"extensionsRequired", {kMeshopt, "KHR_mesh_quantization"}},
        {"scene", 0},
        {"scenes", {{{"nodes", {0}}}}},
        {"nodes", {{{"mesh", 0}, {"matrix", matrix_of(tile)}}}},
        {"meshes",
         {{{"primitives", {{{"attributes", attributes}, {"material", 0}, {"mode", kPoints}}}}}}},
        {"materials", {{{"extensions", {{"KHR_materials_unlit", Json::object()}}}}}},
        {"accessors", accessors},
        {"bufferViews", views},
        {"buffers",
         {{{"byteLength", binary.size()}},
          {{"byteLength", decoded}, {"extensions", {{kMeshopt, {{"fallback", true}}}}}}}}};
    if (Json metadata = metadata_json(tile); !metadata.empty()) {
        json["extensionsUsed"].push_back(kMetadata);
        json["extensions"] = {{kMetadata, std::move(metadata)}};
        json["meshes"][0]["primitives"][0]["extensions"] = {
            {kMetadata, {{"propertyAttributes", {0}}}}};
    }
    const std::string text = to_text(json);

    constexpr std::size_t kHeader = 12, kChunkHeader = 8;
    std::vector<std::byte> glb;
    put(glb, kMagic);
    put(glb, kVersion);
    put(glb, static_cast<std::uint32_t>(kHeader + 2 * kChunkHeader + padded(text.size()) +
                                        binary.size()));
    put_chunk(glb, kJsonChunk, std::as_bytes(std::span(text)), std::byte{' '});
    put_chunk(glb, kBinaryChunk, binary, std::byte{0});
    return glb;
}

LodTile decode_glb(std::span<const std::byte> bytes) try {
    const Chunks chunks = chunks_of(bytes);
    const auto root = nlohmann::json::parse(chunks.json);
    const auto& attributes = root.at("meshes").at(0).at("primitives").at(0).at("attributes");
    const auto& matrix = root.at("nodes").at(0).at("matrix");
    const auto& position = root.at("accessors").at(attributes.at("POSITION").get<std::size_t>());
    LodTile tile;
    tile.points = position.at("count");
    tile.step = matrix.at(0);
    tile.offset = Vec3d(matrix.at(12), -matrix.at(14).get<double>(), matrix.at(13));
    tile.last = position.at("max");
    std::vector<std::pair<std::size_t, std::string>> in_order;  // as they were written
    for (const auto& [name, accessor] : attributes.items()) in_order.emplace_back(accessor, name);
    std::ranges::sort(in_order);
    for (const auto& [accessor, name] : in_order) {
        TileStream& stream =
            tile.streams.emplace_back(read_stream(root, name, accessor, chunks.binary));
        const auto property = property_of(root, name);
        stream.has_no_data = property.contains("noData");
        if (const auto offset = property.find("offset"); offset != property.end())
            stream.offset = offset->is_array() ? offset->at(0) : *offset;
    }
    return tile;
} catch (const nlohmann::json::exception& error) {
    refuse(error.what());
}

}  // namespace stipple::proto
