#pragma once

#include "stipple/error.hpp"
#include "stipple/proto/results.hpp"

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

namespace stipple::cli {

/// @throws Error(NotFound) when there is no such file, Error(InvalidArgument) when what is there is
/// none.
void require_input(const std::filesystem::path& file);
/// @throws Error(InvalidArgument) when an output would take the place of an input or of another
/// output: what was there would be lost. One without a name, and `-`, has no place.
void require_apart(const std::vector<std::filesystem::path>& inputs,
                   const std::vector<std::filesystem::path>& outputs);
/// @throws Error as `require_input`, and where it cannot be read.
std::vector<std::byte> read_file(const std::filesystem::path& file);
/// What the manifest of a pyramid's folder says. @throws Error naming the manifest.
proto::Results read_manifest(const std::filesystem::path& folder);
/// `.ply` of `Scan.PLY`.
std::string extension_of(const std::filesystem::path& file);
/// Renames within a file system: whoever opens `to` sees the old file or the new one.
void move_into_place(const std::filesystem::path& from, const std::filesystem::path& to);
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
