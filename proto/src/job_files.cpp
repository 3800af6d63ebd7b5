#include "job_files.hpp"

#include "stipple/error.hpp"
#include "stipple/proto/digest.hpp"
#include "stipple/proto/problem.hpp"

#include <fcntl.h>
#include <unistd.h>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <string>
#include <utility>

namespace stipple::proto {

namespace fs = std::filesystem;

namespace {

/// A system call on an output file failed with this `errno`.
[[noreturn]] void throw_write_error(int code, const fs::path& file, const JobSpec& spec) {
    if (code == EFBIG) {
        throw Error(ErrorCode::TooLarge,
                    file.filename().string() + ": above the limit of " +
                        std::to_string(spec.max_file_bytes) +
                        " bytes per file: ask for fewer points or another format");
    }
    const std::string failure = file.filename().string() + ": " + std::strerror(code);
    if (code == ENOSPC || code == EDQUOT) throw StorageFull(failure);
    throw Error(ErrorCode::Internal, failure);
}

class OutputDescriptor {
public:
    explicit OutputDescriptor(const fs::path& file)
        : fd_(::open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666)) {}
    ~OutputDescriptor() { close(); }
    OutputDescriptor(const OutputDescriptor&) = delete;
    OutputDescriptor& operator=(const OutputDescriptor&) = delete;

    bool is_open() const noexcept { return fd_ >= 0; }
    bool write(std::span<const std::byte> bytes) {
        while (!bytes.empty()) {
            const ssize_t n = ::write(fd_, bytes.data(), bytes.size());
            if (n < 0 && errno == EINTR) continue;
            if (n < 0) return false;
            bytes = bytes.subspan(static_cast<std::size_t>(n));
        }
        return true;
    }
    bool close() {
        const int fd = std::exchange(fd_, -1);
        return fd < 0 || ::close(fd) == 0;
    }

private:
    int fd_;
};

}  // namespace

void write_whole_file(const fs::path& file, std::span<const std::byte> bytes, const JobSpec& spec) {
    const fs::path partial = file.string() + ".partial";
    OutputDescriptor out(partial);
    if (out.is_open() && out.write(bytes) && out.close() &&
        ::rename(partial.c_str(), file.c_str()) == 0)
        return;
    const int code = errno;
    ::unlink(partial.c_str());
    throw_write_error(code, file, spec);
}

OutputFile write_output(const std::string& stem, CloudFormat format,
                        std::span<const std::byte> bytes, const JobSpec& spec) {
    const std::string hash = sha256_hex(bytes);
    const std::string name = (stem.empty() ? hash : stem) + "." + std::string(to_string(format));
    write_whole_file(fs::path(spec.output_dir) / name, bytes, spec);
    return {format, bytes.size(), hash, name};
}

}  // namespace stipple::proto
