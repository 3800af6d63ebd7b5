#include "cli/files.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>
#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <system_error>

namespace stipple::cli {

namespace fs = std::filesystem;

namespace {

/// `mkdtemp` puts letters and digits for each X.
constexpr std::string_view kScratchName = ".stipple-XXXXXX";
constexpr std::string_view kScratchPrefix = kScratchName.substr(0, kScratchName.find('X'));

/// Also of places where nothing is yet.
bool is_same(const fs::path& a, const fs::path& b) {
    std::error_code error;
    const bool same = fs::equivalent(a, b, error);
    if (!error) return same;
    return fs::weakly_canonical(fs::absolute(without_links(a)), error) ==
           fs::weakly_canonical(fs::absolute(without_links(b)), error);
}

/// As held on an open folder; the end of a process gives it back, however that came.
bool lock(int folder) noexcept {
    return folder >= 0 && ::flock(folder, LOCK_EX | LOCK_NB) == 0;
}

int open_folder(const fs::path& folder) noexcept {
    return ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
}

/// Of this user, and old enough that whoever made it has locked it since.
bool is_abandoned(int folder) noexcept {
    constexpr std::time_t kHour = 3600;
    struct stat status {};
    return ::fstat(folder, &status) == 0 && status.st_uid == ::geteuid() &&
           status.st_mtime + kHour < std::time(nullptr) && lock(folder);
}

/// Removes what runs that were killed have left beside a result.
void remove_abandoned(const fs::path& parent) {
    std::error_code ignored;
    for (fs::directory_iterator entry(parent, ignored), end; entry != end;
         entry.increment(ignored)) {
        const std::string name = entry->path().filename().string();
        if (name.size() != kScratchName.size() || !name.starts_with(kScratchPrefix)) continue;
        const int folder = open_folder(entry->path());
        if (is_abandoned(folder)) fs::remove_all(entry->path(), ignored);
        if (folder >= 0) ::close(folder);
    }
}

std::string text_of(int code) {
    return std::generic_category().message(code);
}

}  // namespace

ScratchFolder::ScratchFolder(const fs::path& parent) {
    remove_abandoned(parent);
    std::string name = (parent / kScratchName).string();
    if (::mkdtemp(name.data()) == nullptr) {
        const int code = errno;
        throw Error(ErrorCode::InvalidArgument,
                    parent.string() + ": cannot write there: " + text_of(code));
    }
    path_ = name;
    lock_ = open_folder(path_);
    lock(lock_);  // where the file system has no locks nothing is removed
}

ScratchFolder::~ScratchFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
    if (lock_ >= 0) ::close(lock_);
}

fs::path temporary_folder() {
    std::error_code error;
    fs::path folder = fs::temp_directory_path(error);
    if (error) {
        const char* const set = std::getenv("TMPDIR");
        throw Error(ErrorCode::InvalidArgument,
                    std::string("TMPDIR ") + (set == nullptr ? "/tmp" : set) +
                        ": expected a folder that can be written; set it to one");
    }
    return folder;
}

void require_input(const fs::path& file) {
    if (file == "-")
        throw Error(ErrorCode::NotFound,
                    "-: no such file; standard input is not read: write it to a file first");
    std::error_code error;
    const fs::file_status status = fs::status(file, error);
    if (status.type() == fs::file_type::not_found)
        throw Error(ErrorCode::NotFound, file.string() + ": no such file");
    if (error)
        throw Error(ErrorCode::InvalidArgument,
                    file.string() + ": cannot be read: " + error.message());
    if (!fs::is_regular_file(status))
        throw Error(ErrorCode::InvalidArgument,
                    file.string() + ": not a regular file: save its contents to one first");
}

void require_apart(const std::vector<fs::path>& inputs, const std::vector<fs::path>& outputs) {
    const auto has_place = [](const fs::path& file) { return !file.empty() && file != "-"; };
    for (auto output = outputs.begin(); output != outputs.end(); ++output) {
        if (!has_place(*output)) continue;
        const auto is_here = [&](const fs::path& other) {
            return has_place(other) && is_same(*output, other);
        };
        const bool is_input = std::ranges::any_of(inputs, is_here);
        if (is_input || std::any_of(outputs.begin(), output, is_here))
            throw Error(ErrorCode::InvalidArgument, output->string() + ": it is " +
                                                        (is_input ? "an input" : "another output") +
                                                        ": give the output another name");
    }
}

std::string extension_of(const fs::path& file) {
    std::string extension = file.extension().string();
    std::ranges::transform(extension, extension.begin(),
                           [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return extension;
}

std::vector<std::byte> read_file(const fs::path& file) {
    require_input(file);
    std::vector<std::byte> bytes(fs::file_size(file));
    std::ifstream stream(file, std::ios::binary);
    stream.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    if (!stream) throw Error(ErrorCode::Internal, file.string() + ": cannot be read");
    return bytes;
}

proto::Results read_manifest(const fs::path& folder) {
    const fs::path manifest = folder / "manifest.json";
    const std::vector<std::byte> text = read_file(manifest);
    return naming(manifest, [&] {
        return proto::results_from_json({reinterpret_cast<const char*>(text.data()), text.size()});
    });
}

fs::path without_links(const fs::path& file) {
    constexpr int kMostLinks = 40;  // as Linux follows
    fs::path place = file;
    std::error_code error;
    for (int links = 0; links < kMostLinks; ++links) {
        const fs::path to = fs::read_symlink(place, error);
        if (error) break;  // no link
        place = place.parent_path() / to;
    }
    return place;
}

fs::path folder_of(const fs::path& file) {
    const fs::path parent = without_links(file).parent_path();
    return parent.empty() ? fs::path(".") : parent;
}

void require_place_of(const fs::path& file) {
    if (file.empty() || file == "-") return;
    std::error_code error;
    const fs::file_status status = fs::status(file, error);
    if (fs::exists(status) && !fs::is_regular_file(status))
        throw Error(ErrorCode::InvalidArgument,
                    file.string() + ": it is " +
                        (fs::is_directory(status) ? "a folder" : "not a regular file") +
                        ": give the output another name");
    const ScratchFolder probe(folder_of(file));
}

void require_files(const std::vector<fs::path>& inputs, const std::vector<fs::path>& outputs) {
    std::ranges::for_each(inputs, require_input);
    std::ranges::for_each(outputs, require_place_of);
    require_apart(inputs, outputs);
}

void move_into_place(const fs::path& from, const fs::path& to) {
    const fs::path place = without_links(to);
    std::error_code error, none;
    const fs::file_status before = fs::status(place, none);
    if (fs::is_regular_file(before)) fs::permissions(from, before.permissions(), error);
    if (!error) fs::rename(from, place, error);
    if (error)
        throw Error(ErrorCode::InvalidArgument,
                    to.string() + ": cannot be written: " + error.message());
}

void write_new_file(const fs::path& file, std::string_view text, const fs::path& named) {
    errno = 0;
    std::ofstream stream(file, std::ios::binary);
    stream << text;
    if (stream) stream.close();
    if (!stream) {
        const int code = errno;
        throw Error(ErrorCode::Internal, named.string() + ": cannot be written" +
                                             (code == 0 ? "" : ": " + text_of(code)));
    }
}

void write_text(const fs::path& file, std::string_view text) {
    const ScratchFolder beside(folder_of(file));
    const fs::path whole = beside.path() / "whole";
    write_new_file(whole, text, file);
    move_into_place(whole, file);
}

Written write_cloud_into_place(const PointCloud& cloud, const fs::path& file,
                               const PlyEncodeOptions& ply, const DracoEncodeOptions& draco,
                               const CopcOptions& copc, const RunContext& context) {
    Written written;
    const std::string extension = extension_of(file);
    const std::vector<std::byte> bytes = [&] {
        try {
            if (extension == ".drc")
                return encode_draco(cloud, draco, context, &written.draco_step);
            if (extension == ".laz") return encode_copc(cloud, copc, context, &written.odd_of_las);
            return encode_cloud(cloud, file, ply, draco, copc, context);
        } catch (const Error& error) {
            throw Error(error.code(), file.string() + ": " + error.what());
        }
    }();
    write_text(file, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    return written;
}

proto::OutputFile& first_output(proto::Results& results) {
    const bool one_each = std::ranges::all_of(
        results.levels, [](const proto::OutputCloud& cloud) { return cloud.files.size() == 1; });
    if (results.levels.empty() || !one_each || !results.source)
        throw Error(ErrorCode::Internal, "the job did not produce one file per cloud: " +
                                             std::to_string(results.levels.size()) +
                                             " clouds arrived");
    return results.levels.front().files.front();
}

Error named_after(const fs::path& file, const Error& error) {
    const bool about_content = error.code() == ErrorCode::MalformedInput ||
                               error.code() == ErrorCode::UnsupportedFormat ||
                               error.code() == ErrorCode::TooLarge;
    const std::string message = error.what();
    if (!about_content || message.starts_with(file.string())) return error;
    return Error(error.code(), file.string() + ": " + message);
}

}  // namespace stipple::cli
