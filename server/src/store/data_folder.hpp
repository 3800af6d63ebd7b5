#pragma once

#include "store/posix_file.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace stipple::server {

/// The folder of a store (`--data`): its database, its blobs, scratch for running jobs, a lock for
/// each part of the service.

std::filesystem::path database_in(const std::filesystem::path& folder);
std::filesystem::path blobs_in(const std::filesystem::path& folder);
std::filesystem::path scratch_in(const std::filesystem::path& folder);

/// Whether a store was made there: it has a database, and not an empty one, which knows of no file.
/// @throws Error for a database that is damaged, another program's or a newer version's.
bool is_store(const std::filesystem::path& folder);

/// Makes the folder where there is none. @throws Error(InvalidArgument) when that fails, for a
/// folder of somebody else's: not a store, but with files where a store has its own; and for a
/// store that names files and has none.
void make_data_folder(const std::filesystem::path& folder);

/// Each part (`api`, `worker`) runs once on a folder: the locks live as long as they are kept.
/// @throws Error(Conflict) when another process has one.
std::vector<FileDescriptor> lock_parts(const std::filesystem::path& folder,
                                       const std::vector<std::string>& parts);
/// The same for one who only reads: what no part has locked yet is not made for it.
std::vector<FileDescriptor> lock_parts_to_read(const std::filesystem::path& folder,
                                               const std::vector<std::string>& parts);

/// Removes from a folder, made when missing, what a killed process left there: files and folders
/// with the name of a job or of an unfinished file, 32 hexadecimal digits. Whatever has another
/// name stays. @throws Error(InvalidArgument) for a link to a folder.
void clear_leftovers(const std::filesystem::path& folder);

}  // namespace stipple::server
