#pragma once

#include "stipple/codec.hpp"
#include "stipple/error.hpp"
#include "stipple/proto/results.hpp"

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace stipple::cli {

/// A folder beside or in the one where results will stand, so that moving them there is one step;
/// gone in the end. One that a killed run has left goes with the next of the same place.
class ScratchFolder {
public:
    /// @throws Error naming `parent` when nothing can be written there.
    explicit ScratchFolder(const std::filesystem::path& parent);
    ~ScratchFolder();
    ScratchFolder(const ScratchFolder&) = delete;
    ScratchFolder& operator=(const ScratchFolder&) = delete;
    const std::filesystem::path& path() const noexcept { return path_; }

private:
    std::filesystem::path path_;
    int lock_ = -1;  ///< held while it is in use
};

/// Where scratch folders of results without a place of their own stand: TMPDIR, else /tmp.
/// @throws Error naming TMPDIR when there is no such folder.
std::filesystem::path temporary_folder();
/// What is read where nobody else waits: any number of attributes.
inline constexpr DecodeLimits limits_here() {
    return {.max_attributes = DecodeLimits::kAnyAttributes};
}
/// @throws Error(NotFound) when there is no such file, Error(InvalidArgument) when what is there is
/// none, or cannot be reached.
void require_input(const std::filesystem::path& file);
/// @throws Error(InvalidArgument) when an output would take the place of an input or of another
/// output: what was there would be lost. One without a name, and `-`, has no place.
void require_apart(const std::vector<std::filesystem::path>& inputs,
                   const std::vector<std::filesystem::path>& outputs);
/// Before the work: every input is there, and every output has a place of its own in which it can
/// be written. @throws Error as `require_input`, `require_place_of` and `require_apart`.
void require_files(const std::vector<std::filesystem::path>& inputs,
                   const std::vector<std::filesystem::path>& outputs);
/// @throws Error as `require_input`, and where it cannot be read.
std::vector<std::byte> read_file(const std::filesystem::path& file);
/// What the manifest of a pyramid's folder says. @throws Error naming the manifest.
proto::Results read_manifest(const std::filesystem::path& folder);
/// `.ply` of `Scan.PLY`.
std::string extension_of(const std::filesystem::path& file);
/// The file that a link leads to, also where none is yet; any other file itself.
std::filesystem::path without_links(const std::filesystem::path& file);
/// The folder in which `file` stands, as a path that can be opened; of a link, that of its file.
std::filesystem::path folder_of(const std::filesystem::path& file);
/// Before the work that ends in the file; a file without a name, or named `-`, needs no place.
/// @throws Error naming the file, when it stands in the way as a folder, or its folder, when
/// nothing can be written there.
void require_place_of(const std::filesystem::path& file);
/// Renames within a file system: whoever opens `to` sees the old file or the new one, with the
/// permissions of the old. A link stays one.
void move_into_place(const std::filesystem::path& from, const std::filesystem::path& to);
/// Whole or not at all. @throws Error naming the file, and why it could not be written.
void write_text(const std::filesystem::path& file, std::string_view text);
/// Into a scratch folder.
/// @param named  what an error calls it: where it is to be in the end.
void write_new_file(const std::filesystem::path& file, std::string_view text,
                    const std::filesystem::path& named);
/// What there is to tell of a cloud in a file.
struct Written {
    double draco_step = 0;                ///< of a Draco file's grid; 0: none
    std::vector<std::string> odd_of_las;  ///< as `encode_copc` tells it
};
/// A cloud, likewise, in the format that the end of the name says (`.ply`, `.drc`, `.stpc`,
/// `.laz`); a failure to encode it names the file, too.
Written write_cloud_into_place(const PointCloud& cloud, const std::filesystem::path& file,
                               const PlyEncodeOptions& ply, const DracoEncodeOptions& draco,
                               const CopcOptions& copc, const RunContext& context);
/// The one file of the first cloud that a job made. @throws Error(Internal) when a server sent
/// another number of them.
proto::OutputFile& first_output(proto::Results& results);

/// `error` with the file in front, unless it stands there already.
Error named_after(const std::filesystem::path& file, const Error& error);

/// Calls `work`, whose failures are about the content of `file`, and puts its name in front of
/// them.
template <typename Work>
auto naming(const std::filesystem::path& file, Work&& work) {
    try {
        return work();
    } catch (const Error& error) {
        throw named_after(file, error);
    }
}

}  // namespace stipple::cli
