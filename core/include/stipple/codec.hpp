#pragma once

#include "stipple/copc.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstddef>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace stipple {

enum class CloudFormat {
    Ply,
    Draco,
    Glb,          ///< tiles of a pyramid (`LodTiler`) as binary glTF: written, never read
    Progressive,  ///< a stream of which every prefix is a cloud (`encode_progressive`)
    Copc,         ///< an octree in a LAZ file (`encode_copc`): written, never read
};

/// `ply`, `drc`, `glb`, `stpc`, `copc.laz`: the name on the wire and the extension of a file.
std::string_view to_string(CloudFormat format) noexcept;
/// `model/ply`, `model/vnd.google.draco`... as sent in `Content-Type`.
std::string_view media_type(CloudFormat format) noexcept;
/// The inverse of `to_string`; also `draco`, `stream` and `copc`. @throws Error(UnsupportedFormat)
/// naming what is offered.
CloudFormat cloud_format_from_name(std::string_view name);
/// By the first bytes (`ply`, `DRACO` or `STPC`), never by a file's name; nothing when it is none.
std::optional<CloudFormat> detect_format(std::span<const std::byte> head) noexcept;

/// What a decoder accepts. Checked against what the header declares, before anything is allocated.
struct DecodeLimits {
    std::uint64_t max_points = 200'000'000;
    unsigned max_attributes = 64;  ///< scalar properties beyond positions, normals and colours
    std::uint64_t max_memory_bytes = 0;  ///< of this process, when the caller has set such a limit:
                                         ///< told by the error of a file that needs more
};

/// What the file was and what was left out of the cloud.
struct DecodeReport {
    CloudFormat format = CloudFormat::Ply;
    std::string encoding;  ///< `ascii`, `binary_little_endian`, `binary_big_endian`; `sequential`,
                           ///< `kd-tree`, `edgebreaker`; `progressive`
    std::uint64_t points = 0;  ///< points in the cloud, before any cleaning
    std::uint64_t faces = 0;   ///< faces that were ignored
    std::vector<std::string>
        skipped;  ///< elements and list properties that were left out, as `face.vertex_indices`
    std::vector<std::string>
        comments;  ///< `comment` and `obj_info` lines of a PLY header, without the keyword
};

/// Decodes a PLY, Draco or progressive file that lies in memory (or is mapped there).
///
/// PLY: ascii, little and big endian; any property types and names; elements in any order. Double
/// or 32-bit integer coordinates are kept through `PointCloud::origin` (float relative to the
/// centre of the box). Colours under their usual names (`red`, `r`, `diffuse_red`; 8 bits; 16
/// bits, which are scaled unless no value is above 255; or float 0..1) become `colors`; `nx ny nz`
/// become `normals`, as they are; every other scalar property becomes an attribute; a list property
/// of the points is kept as an attribute of several components when all its lists have one length,
/// else left out and named in the report. The type `bool` is a byte; numbers beyond a type's range
/// become infinite or zero; unknown header lines before the first element are passed over and named
/// in the report. Draco: point clouds and meshes (the faces are ignored); generic attributes with
/// their names from the metadata. Progressive: all points that the bytes reach, see
/// `ProgressiveDecoder`.
///
/// @param report  filled when not null.
/// @throws Error(UnsupportedFormat) for bytes in none of these formats; Error(MalformedInput)
/// naming what is wrong and where (line or byte offset); Error(TooLarge) over a limit.
///
/// Nothing is allocated beyond what the input can hold. Google's Draco decoder can still ask for
/// all memory, and looks at `context.stop` before and after its work only, which takes seconds for
/// ten million points: decode foreign bytes in a process with a memory limit, which can be ended
/// from outside.
PointCloud decode_cloud(std::span<const std::byte> bytes, const DecodeLimits& limits = {},
                        const RunContext& context = {}, DecodeReport* report = nullptr);

/// `decode_cloud` on a memory-mapped file.
PointCloud read_cloud(const std::filesystem::path& file, const DecodeLimits& limits = {},
                      const RunContext& context = {}, DecodeReport* report = nullptr);

enum class PlyEncoding { BinaryLittleEndian, BinaryBigEndian, Ascii };

struct PlyEncodeOptions {
    PlyEncoding encoding = PlyEncoding::BinaryLittleEndian;
    std::vector<std::string> comments;  ///< one line each
};

enum class DracoCoding {
    Auto,  ///< kd-tree for bare positions, else sequential (smaller with normals and colours)
           ///< along a chain through the points, where differences take few bits: with normals
           ///< a quarter to a third smaller than in an order at random
    Sequential,  ///< keeps the order of the points
    KdTree,      ///< reorders the points
};

struct DracoEncodeOptions {
    DracoCoding coding = DracoCoding::Auto;
    unsigned position_bits = 14;  ///< 1..30 bits per axis of the longest side, of the box about
                                  ///< most points where a few lie far off; 0: unquantised floats
    std::optional<double>
        precision;  ///< instead of position_bits: the largest error per axis, in input units
    unsigned normal_bits = 10;  ///< 2..30, octahedral
    unsigned attribute_bits =
        16;  ///< 1..30 for floating-point attributes; 0: unquantised. Integers are lossless, floats
             ///< that are all whole numbers as well.
    unsigned compression_level = 7;  ///< 0 fastest .. 10 smallest
};

/// Encodes a cloud. Draco keeps every point (duplicates too) and every attribute; generic
/// attributes carry their name in the metadata entry `name`, the origin stands in the geometry's
/// metadata as `stipple.origin` (3 doubles). Unique ids are fixed: position 0, normal 1, colour 2,
/// generic attributes from 3 on in the order of the cloud. Doubles, wide integers and values that
/// are not finite are coded without loss, which the kd-tree cannot: asked for it, such a cloud is
/// refused, and `Auto` takes the sequential coding. An empty cloud keeps only its origin.
/// @throws Error(InvalidArgument) for an option out of range. Google's encoder, too, looks at
/// `context.stop` before and after its work only.
std::vector<std::byte> encode_ply(const PointCloud& cloud, const PlyEncodeOptions& options = {},
                                  const RunContext& context = {});
std::vector<std::byte> encode_draco(const PointCloud& cloud, const DracoEncodeOptions& options = {},
                                    const RunContext& context = {});
/// The same, and spends the cloud: each part of it is given back once Draco has it, so that as much
/// memory less is needed.
std::vector<std::byte> encode_draco(PointCloud&& cloud, const DracoEncodeOptions& options = {},
                                    const RunContext& context = {});

/// Writes a cloud, the format by the extension (`.ply`, `.drc`, `.stpc`, `.laz`: `encode_copc`),
/// through a temporary file beside it, so that a file of that name is whole or not there. @throws
/// Error(UnsupportedFormat) for another extension, Error(NotFound) for a folder that is not there,
/// Error(InvalidArgument) where one may not write, Error(Internal) when it cannot be written else.
void write_cloud(const PointCloud& cloud, const std::filesystem::path& file,
                 const PlyEncodeOptions& ply = {}, const DracoEncodeOptions& draco = {},
                 const CopcOptions& copc = {}, const RunContext& context = {});

}  // namespace stipple
