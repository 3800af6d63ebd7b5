#include "store/data_folder.hpp"

#include "store/job_store.hpp"
#include "store/sqlite_schema.hpp"

#include "stipple/error.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <optional>
#include <string_view>
#include <thread>

namespace stipple::server {

namespace {

namespace fs = std::filesystem;

Error unusable(const fs::path& folder, const std::string& why) {
    return {ErrorCode::InvalidArgument, "--data " + folder.string() + ": " + why};
}

/// A file below a folder, or nothing when there are none: a store in the making has empty folders.
std::optional<fs::path> any_file_in(const fs::path& folder) {
    std::error_code failure;
    if (!fs::is_directory(folder, failure)) return std::nullopt;
    // A disk that is mounted there may have folders of its own, as `lost+found`.
    constexpr auto kOwnOnly = fs::directory_options::skip_permission_denied;
    for (auto entry = fs::recursive_directory_iterator(folder, kOwnOnly, failure);
         !failure && entry != fs::recursive_directory_iterator(); entry.increment(failure)) {
        if (!fs::is_directory(entry->symlink_status())) return entry->path();
    }
    return std::nullopt;
}

void refuse_foreign(const fs::path& folder) {
    for (const fs::path& own : {blobs_in(folder), scratch_in(folder)}) {
        // In this order: the database of a store that another process makes comes before its files.
        const std::optional<fs::path> file = any_file_in(own);
        if (!file || is_store(folder)) continue;
        const fs::path database = database_in(folder);
        throw unusable(folder,
                       "it has " + file->lexically_relative(folder).string() +
                           (fs::exists(database) ? ", but an empty " : ", but no ") +
                           database.filename().string() +
                           ", so it is not a store, and its files would be removed: give another "
                           "folder, put the database back, or move " +
                           own.filename().string() + " elsewhere");
    }
}

/// A store without any of the files that it names is one whose disk is away: what is stored instead
/// would vanish when that is back.
void refuse_without_blobs(const fs::path& folder) {
    const fs::path blobs = blobs_in(folder), database = database_in(folder);
    if (any_file_in(blobs) || !is_store(folder)) return;
    const std::vector<std::string> named = read_referenced_blobs(database);
    // Looked at again: another process may have stored its first.
    if (named.empty() || any_file_in(blobs)) return;
    throw unusable(folder, "its " + database.filename().string() + " names " +
                               std::to_string(named.size()) + " stored files, but " +
                               blobs.filename().string() +
                               (fs::exists(blobs) ? " has none" : " is missing") +
                               ": mount its disk or put the files back; to begin anew, move " +
                               database.filename().string() + " elsewhere, or give another folder");
}

/// Of a server that was killed while it started a job, the job's process still holds the lock until
/// it has become another program: a moment, on a busy machine a longer one.
bool take_lock(const FileDescriptor& file) {
    constexpr int kTries = 20;
    constexpr std::chrono::milliseconds kPause{50};
    for (int tries = 1; ::flock(file.get(), LOCK_EX | LOCK_NB) != 0; ++tries) {
        if (tries == kTries) return false;
        std::this_thread::sleep_for(kPause);
    }
    return true;
}

std::vector<FileDescriptor> lock(const fs::path& folder, const std::vector<std::string>& parts,
                                 int flags) {
    std::vector<FileDescriptor> locks;
    for (const std::string& part : parts) {
        const fs::path file = folder / (part + ".lock");
        FileDescriptor fd = open_file(file, flags);
        if (!fd && errno == ENOENT && (flags & O_CREAT) == 0) continue;
        if (!fd) throw_errno("cannot open", file);
        if (!take_lock(fd)) {
            throw Error(
                ErrorCode::Conflict,
                "--data " + folder.string() + ": another stippled runs on this folder as " + part);
        }
        locks.push_back(std::move(fd));
    }
    return locks;
}

/// Of a temporary file or folder: as `proto::random_hex(16)` makes them, in scratch with a dash and
/// the token of the attempt behind.
bool is_temporary(std::string_view name) {
    constexpr std::size_t kDigits = 32;
    const auto dash = std::min(name.find('-'), name.size());
    const std::string_view random = name.substr(0, dash), token = name.substr(dash);
    return random.size() == kDigits &&
           random.find_first_not_of("0123456789abcdef") == random.npos &&
           (token.empty() ||
            (token.size() > 1 && token.find_first_not_of("0123456789", 1) == token.npos));
}

}  // namespace

fs::path database_in(const fs::path& folder) {
    return folder / "stipple.sqlite";
}
fs::path blobs_in(const fs::path& folder) {
    return folder / "blobs";
}
fs::path scratch_in(const fs::path& folder) {
    return folder / "scratch";
}

bool is_store(const fs::path& folder) {
    const fs::path database = database_in(folder);
    std::error_code missing;
    if (fs::file_size(database, missing) == 0 || missing) return false;
    sqlite::Connection connection(database, sqlite::Access::Read);
    return sqlite::check_schema(connection) > 0;
}

void make_data_folder(const fs::path& folder) {
    std::error_code error;
    fs::create_directories(folder, error);
    if (error) throw unusable(folder, "cannot be created: " + error.message());
    refuse_foreign(folder);
    refuse_without_blobs(folder);
}

std::vector<FileDescriptor> lock_parts(const fs::path& folder,
                                       const std::vector<std::string>& parts) {
    return lock(folder, parts, O_RDWR | O_CREAT);
}

std::vector<FileDescriptor> lock_parts_to_read(const fs::path& folder,
                                               const std::vector<std::string>& parts) {
    return lock(folder, parts, O_RDONLY);
}

void clear_leftovers(const fs::path& folder) {
    if (fs::is_symlink(folder)) {
        throw Error(ErrorCode::InvalidArgument,
                    folder.string() +
                        ": it is a link, and files in it are removed: expected a folder: remove "
                        "the link, or mount another disk there");
    }
    fs::create_directories(folder);
    for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
        if (is_temporary(entry.path().filename().string())) fs::remove_all(entry.path());
    }
}

}  // namespace stipple::server
