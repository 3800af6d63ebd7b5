#pragma once

#include <sys/stat.h>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>

namespace stipple::server {

/// An open file, closed at the end.
class FileDescriptor {
public:
    FileDescriptor() = default;
    explicit FileDescriptor(int fd) noexcept : fd_(fd) {}
    FileDescriptor(FileDescriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
    FileDescriptor& operator=(FileDescriptor&& other) noexcept {
        std::swap(fd_, other.fd_);
        return *this;
    }
    ~FileDescriptor();

    int get() const noexcept { return fd_; }
    explicit operator bool() const noexcept { return fd_ >= 0; }

private:
    int fd_ = -1;
};

/// What changes when a file is written or another is put in its place: device, number, size, and
/// the time of the last change in s and ns, which nobody can set back.
using FileIdentity = std::tuple<dev_t, ino_t, off_t, std::int64_t, std::int64_t>;
inline FileIdentity identity_of(const struct stat& status) noexcept {
    return {status.st_dev, status.st_ino, status.st_size, status.st_ctim.tv_sec,
            status.st_ctim.tv_nsec};
}

/// Throws StoreFault for `errno`; proto::StorageFull when the disk or the quota is.
[[noreturn]] void throw_errno(std::string_view what, const std::filesystem::path& file);

/// `open(2)`, never inherited by a child. Invalid, with `errno`, when it fails.
FileDescriptor open_file(const std::filesystem::path& file, int flags, unsigned mode = 0640);

/// All bytes, however many calls it takes. @throws as `throw_errno`.
void write_all(const FileDescriptor& fd, std::span<const std::byte> bytes,
               const std::filesystem::path& file);

/// As many bytes from `offset` as there are, up to `out.size()`. @throws as `throw_errno`.
std::size_t read_at(const FileDescriptor& fd, std::uint64_t offset, std::span<std::byte> out,
                    const std::filesystem::path& file);

/// Waits until the file (or the names in a folder) would survive a power cut.
void sync_file(const FileDescriptor& fd, const std::filesystem::path& file);
void sync_folder(const std::filesystem::path& folder);
/// The same for all of the file system that the folder is in, whoever wrote it: of many files
/// quicker than one by one.
void sync_file_system(const std::filesystem::path& folder);

}  // namespace stipple::server
