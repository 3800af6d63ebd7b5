#pragma once

#include "stipple/error.hpp"
#include "stipple/proto/results.hpp"

#include <filesystem>
#include <string>

namespace stipple::cli {

/// @throws Error(NotFound) when there is no such file, or what is there is none.
void require_input(const std::filesystem::path& file);
/// @throws Error(InvalidArgument) when the output would take the input's place: what was left out
/// would be lost.
void require_apart(const std::filesystem::path& input, const std::filesystem::path& output);
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
