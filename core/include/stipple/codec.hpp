#pragma once

#include "stipple/copc.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
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

/// `ply`, `drc`, `glb`, `stpc`, `copc.laz`: the name in requests and the extension of a file.
std::string_view to_string(CloudFormat format) noexcept;
/// `model/ply`, `model/vnd.google.draco`... as sent in `Content-Type`.
std::string_view media_type(CloudFormat format) noexcept;
/// The inverse of `to_string`; also accepts `draco`, `stream` and `copc`.
/// @throws Error(UnsupportedFormat) naming the formats offered.
CloudFormat cloud_format_from_name(std::string_view name);
/// What `decode_cloud` reads.
inline constexpr std::array kReadFormats = {CloudFormat::Ply, CloudFormat::Draco,
                                            CloudFormat::Progressive};
/// Which of these a file is in by its first bytes (`ply`, `DRACO` or `STPC`), never by its name;
/// nothing for any other.
std::optional<CloudFormat> detect_format(std::span<const std::byte> head) noexcept;

/// What a decoder accepts. Checked against what the header declares, before anything is allocated.
struct DecodeLimits {
    static constexpr unsigned kAnyAttributes = std::numeric_limits<unsigned>::max();

    std::uint64_t max_points = 200'000'000;
    unsigned max_attributes = 64;  ///< scalar properties beyond positions, normals and colours
    std::uint64_t max_memory_bytes = 0;  ///< the memory limit of this process, if the caller has
                                         ///< set one: named in the error for a file that needs more
};

/// Refuses by the first bytes of a file what `decode_cloud` would refuse once all are there: what
/// it does not read and, if they hold the header of a PLY file, one that is invalid, declares more
/// than the limits allow, or more than the file can hold. All else is for `decode_cloud` to find.
/// @param file_bytes  the size of the whole file
/// @return the format. @throws Error as `decode_cloud`. Cost: linear in the bytes given.
CloudFormat check_head(std::span<const std::byte> head, std::uint64_t file_bytes,
                       const DecodeLimits& limits = {});

/// What the file contained and what was dropped.
struct DecodeReport {
    CloudFormat format = CloudFormat::Ply;
    std::string encoding;  ///< `ascii`, `binary_little_endian`, `binary_big_endian`; `sequential`,
                           ///< `kd-tree`, `edgebreaker`; `progressive`
    std::uint64_t points = 0;  ///< points in the cloud, before any cleaning
    std::uint64_t faces = 0;   ///< ignored faces
    std::vector<std::string>
        skipped;  ///< ignored elements and list properties, such as `face.vertex_indices`; in
                  ///< words, what a file holds beyond all that its header declares, what 16-bit
                  ///< colours and 64-bit integers lose, and the names that had to be changed
    std::vector<std::string>
        comments;  ///< `comment` and `obj_info` lines of a PLY header, without the keyword
};

/// Decodes a PLY, Draco or progressive file in memory (or mapped there).
///
/// PLY: ascii, little and big endian; any property types and names; elements in any order. Double
/// or wide integer coordinates are kept through `PointCloud::origin` (float relative to the centre
/// of the box). Colours under their usual names (`red`, `r`, `diffuse_red`; 8 bits; 16 bits or
/// more, which are scaled unless no value is above 255; or float 0..1) become `colors`; `nx ny nz`
/// become `normals` (small integers as shares of their range); every other scalar property becomes
/// an attribute, 64-bit integers one of doubles, which hold all up to 2^53. An attribute whose name
/// no PLY file can have, or needs for coordinates, normals or colours, gets another one: `h_he`,
/// `red_2`. A list property of the points becomes an attribute of several components if all its
/// lists have one length; otherwise it is ignored and named in the report. The type `bool` is a
/// byte; numbers beyond a type's range become infinite or zero; unknown header lines before the
/// first element are skipped and named in the report. Draco: point clouds and meshes (ignoring
/// faces); generic attributes with their names from the metadata. Progressive: all points that the
/// bytes contain, see `ProgressiveDecoder`.
///
/// @param report  filled unless null.
/// @throws Error(UnsupportedFormat) for bytes in none of these formats; Error(MalformedInput)
/// naming what is wrong and where (line or byte offset); Error(TooLarge) over a limit.
///
/// Allocates no more than the input can hold. Google's Draco decoder may still request all memory,
/// and checks `context.stop` only before and after its work, which takes seconds for ten million
/// points: decode untrusted bytes in a process with a memory limit, which can be killed.
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
    Auto,  ///< kd-tree for positions alone, otherwise sequential (smaller with normals and colours)
           ///< along a chain through the points, where differences take few bits: with normals a
           ///< quarter to a third smaller than in random order
    Sequential,  ///< keeps the order of the points
    KdTree,      ///< reorders the points
};

struct DracoEncodeOptions {
    DracoCoding coding = DracoCoding::Auto;
    unsigned position_bits =
        14;  ///< 1..30 bits per axis, for the longest side; if a few points lie far off, for the
             ///< box around most points; 0: unquantised floats
    std::optional<double>
        precision;  ///< instead of position_bits: the largest error per axis, in input units
    unsigned normal_bits = 10;  ///< 2..30, octahedral
    unsigned attribute_bits =
        16;  ///< 1..30 for floating-point attributes; 0: unquantised. Integers are lossless, as are
             ///< floats that are all whole numbers.
    unsigned compression_level = 7;  ///< 0 fastest .. 10 smallest; of the sequential coding all
                                     ///< levels take about as long and as many bytes
};

/// Encodes a cloud. Draco keeps every point (including duplicates) and every attribute; generic
/// attributes carry their name in the metadata entry `name`, the geometry's metadata holds the
/// origin as `stipple.origin` (3 doubles). Unique ids are fixed: position 0, normal 1, colour 2,
/// generic attributes from 3 on in the order of the cloud. Doubles, wide integers and values that
/// are not finite are coded losslessly, which the kd-tree cannot do: it refuses such a cloud, and
/// `Auto` uses the sequential coding. Normals of which none has a direction, as in files of
/// Gaussian splats, are left out: Draco would give them one. An empty cloud keeps only its origin.
/// @param step  unless null, set to that of the positions' grid, input units; 0: they are exact.
/// @throws Error(InvalidArgument) for an option out of range.
///
/// Google's encoder, too, checks `context.stop` only before and after its work.
std::vector<std::byte> encode_ply(const PointCloud& cloud, const PlyEncodeOptions& options = {},
                                  const RunContext& context = {});
std::vector<std::byte> encode_draco(const PointCloud& cloud, const DracoEncodeOptions& options = {},
                                    const RunContext& context = {}, double* step = nullptr);
/// The same, consuming the cloud: each part of it is freed once Draco has it, which saves that much
/// memory.
std::vector<std::byte> encode_draco(PointCloud&& cloud, const DracoEncodeOptions& options = {},
                                    const RunContext& context = {}, double* step = nullptr);

/// Encodes a cloud in the format of the file's extension (`.ply`, `.drc`, `.stpc`, `.laz`:
/// `encode_copc`; of `.stpc` the position bits, 1..24, or the precision are those for `.drc`).
/// @throws Error(UnsupportedFormat) for another extension.
std::vector<std::byte> encode_cloud(const PointCloud& cloud, const std::filesystem::path& file,
                                    const PlyEncodeOptions& ply = {},
                                    const DracoEncodeOptions& draco = {},
                                    const CopcOptions& copc = {}, const RunContext& context = {});

/// Writes what `encode_cloud` makes, through a temporary file beside it, so that the file is either
/// complete or absent.
/// @throws Error(UnsupportedFormat) for another extension, Error(NotFound) for a missing folder,
/// Error(InvalidArgument) if writing is not permitted, Error(Internal) for any other write failure.
void write_cloud(const PointCloud& cloud, const std::filesystem::path& file,
                 const PlyEncodeOptions& ply = {}, const DracoEncodeOptions& draco = {},
                 const CopcOptions& copc = {}, const RunContext& context = {});

}  // namespace stipple
