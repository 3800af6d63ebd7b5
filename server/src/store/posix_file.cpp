#include "store/posix_file.hpp"

#include "store/store_fault.hpp"

#include "stipple/proto/problem.hpp"

#include <fcntl.h>
#include <unistd.h>
#include <cerrno>
#include <cstdint>
#include <system_error>

namespace stipple::server {

FileDescriptor::~FileDescriptor() {
    if (fd_ >= 0) ::close(fd_);
}

void throw_errno(std::string_view what, const std::filesystem::path& file) {
    const int code = errno;
    const bool full = code == ENOSPC || code == EDQUOT;
    const std::string reason = std::generic_category().message(code);
    const std::string failure = std::string(what) + ' ' + file.string() + ": " + reason;
    if (full) throw proto::StorageFull(failure);
    throw StoreFault(failure);
}

FileDescriptor open_file(const std::filesystem::path& file, int flags, unsigned mode) {
    int fd = -1;
    do fd = ::open(file.c_str(), flags | O_CLOEXEC, mode);
    while (fd < 0 && errno == EINTR);
    return FileDescriptor(fd);
}

void write_all(const FileDescriptor& fd, std::span<const std::byte> bytes,
               const std::filesystem::path& file) {
    while (!bytes.empty()) {
        const ssize_t written = ::write(fd.get(), bytes.data(), bytes.size());
        if (written < 0 && errno == EINTR) continue;
        if (written < 0) throw_errno("cannot write", file);
        bytes = bytes.subspan(static_cast<std::size_t>(written));
    }
}

std::size_t read_at(const FileDescriptor& fd, std::uint64_t offset, std::span<std::byte> out,
                    const std::filesystem::path& file) {
    std::size_t filled = 0;
    while (filled < out.size()) {
        const ssize_t n = ::pread(fd.get(), out.data() + filled, out.size() - filled,
                                  static_cast<off_t>(offset + filled));
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) throw_errno("cannot read", file);
        if (n == 0) break;
        filled += static_cast<std::size_t>(n);
    }
    return filled;
}

void sync_file(const FileDescriptor& fd, const std::filesystem::path& file) {
    if (::fsync(fd.get()) != 0) throw_errno("cannot sync", file);
}

void sync_folder(const std::filesystem::path& folder) {
    const FileDescriptor fd = open_file(folder, O_RDONLY | O_DIRECTORY);
    if (!fd) throw_errno("cannot open", folder);
    sync_file(fd, folder);
}

void sync_file_system(const std::filesystem::path& folder) {
    const FileDescriptor fd = open_file(folder, O_RDONLY | O_DIRECTORY);
    if (!fd) throw_errno("cannot open", folder);
    if (::syncfs(fd.get()) != 0) throw_errno("cannot sync", folder);
}

}  // namespace stipple::server
