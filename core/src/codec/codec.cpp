#include "stipple/codec.hpp"

#include "base/in_quotes.hpp"
#include "codec/draco.hpp"
#include "codec/ply.hpp"
#include "stipple/error.hpp"
#include "stipple/progressive_cloud.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#include <algorithm>
#include <array>
#include <atomic>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <string_view>
#include <system_error>
#include <utility>

namespace stipple {

namespace {

namespace fs = std::filesystem;

std::string_view as_text(std::span<const std::byte> bytes) noexcept {
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// What a file is, as far as can be told, that is in no format that is read; and what to do.
std::string describe_unknown(std::string_view text) {
    using namespace std::string_view_literals;
    constexpr std::array kPacked = {"\x1F\x8B"sv, "PK\x03\x04"sv, "\x28\xB5\x2F\xFD"sv};
    if (text.starts_with("ply")) {
        return "it begins with 'ply', but no line break follows: send the bytes as they are, with "
               "curl by --data-binary, since -d takes line breaks out";
    }
    if (std::ranges::any_of(kPacked, [text](auto magic) { return text.starts_with(magic); }))
        return "it is a packed file: unpack it first";
    if (text.starts_with("LASF"))
        return "it is a LAS or LAZ file: convert it to PLY first, as with CloudCompare";
    if (text.starts_with("version https:/"))
        return "it is a Git LFS pointer, not the file: fetch it with 'git lfs pull'";
    constexpr std::size_t kQuoted = 16;
    return "the file starts with " + in_quotes(text.substr(0, kQuoted)) +
           ", expected 'ply' and a line break, 'DRACO' or 'STPC'";
}

/// @throws Error(UnsupportedFormat) for what is in none that is read.
CloudFormat format_of(std::span<const std::byte> bytes) {
    if (const auto format = detect_format(bytes)) return *format;
    const std::string_view text = as_text(bytes);
    throw Error(ErrorCode::UnsupportedFormat,
                text.empty()
                    ? "the file is empty: expected PLY, Draco or a progressive stream"
                    : "neither PLY, Draco nor a progressive stream: " + describe_unknown(text));
}

[[noreturn]] void fail_io(const std::string& what, const fs::path& file, int error) {
    ErrorCode code = ErrorCode::Internal;
    if (error == ENOENT || error == ENOTDIR) code = ErrorCode::NotFound;
    if (error == EACCES || error == EISDIR) code = ErrorCode::InvalidArgument;
    throw Error(code, what + " " + file.string() + ": " + std::generic_category().message(error));
}

class FileDescriptor {
public:
    explicit FileDescriptor(int fd) noexcept : fd_(fd) {}
    ~FileDescriptor() { close(); }
    FileDescriptor(const FileDescriptor&) = delete;
    FileDescriptor& operator=(const FileDescriptor&) = delete;
    int get() const noexcept { return fd_; }
    int close() noexcept { return fd_ < 0 ? 0 : ::close(std::exchange(fd_, -1)); }

private:
    int fd_;
};

/// The bytes of a file: mapped, or read when it is a pipe.
class FileBytes {
public:
    explicit FileBytes(const fs::path& file) {
        const FileDescriptor fd(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
        if (fd.get() < 0) fail_io("cannot open", file, errno);
        struct stat status {};
        if (::fstat(fd.get(), &status) != 0) fail_io("cannot inspect", file, errno);
        if (S_ISDIR(status.st_mode)) fail_io("cannot read", file, EISDIR);
        if (!S_ISREG(status.st_mode)) {
            read_all(fd.get(), file);
        } else if (status.st_size > 0) {
            map(fd.get(), static_cast<std::size_t>(status.st_size), file);
        }
    }
    ~FileBytes() {
        if (mapped_ != nullptr) ::munmap(mapped_, size_);
    }
    FileBytes(const FileBytes&) = delete;
    FileBytes& operator=(const FileBytes&) = delete;

    std::span<const std::byte> get() const noexcept {
        if (mapped_ != nullptr) return {static_cast<const std::byte*>(mapped_), size_};
        return read_;
    }

private:
    void map(int fd, std::size_t size, const fs::path& file) {
        // Every page is needed: taken all at once, it costs a fraction of the faults one by one.
        void* const at = ::mmap(nullptr, size, PROT_READ, MAP_PRIVATE | MAP_POPULATE, fd, 0);
        if (at == MAP_FAILED && errno == ENOMEM) throw std::bad_alloc();
        if (at == MAP_FAILED) fail_io("cannot map", file, errno);
        mapped_ = at;
        size_ = size;
    }

    void read_all(int fd, const fs::path& file) {
        constexpr std::size_t kChunk = std::size_t{1} << 20;
        for (std::size_t have = 0;;) {
            read_.resize(have + kChunk);
            const ssize_t got = ::read(fd, read_.data() + have, kChunk);
            if (got < 0 && errno != EINTR) fail_io("cannot read", file, errno);
            have += got > 0 ? static_cast<std::size_t>(got) : 0;
            read_.resize(have);
            if (got == 0) return;
        }
    }

    void* mapped_ = nullptr;
    std::size_t size_ = 0;
    std::vector<std::byte> read_;
};

void write_all(int fd, std::span<const std::byte> bytes, const fs::path& file) {
    while (!bytes.empty()) {
        const ssize_t put = ::write(fd, bytes.data(), bytes.size());
        if (put < 0 && errno == EINTR) continue;
        if (put < 0) fail_io("cannot write", file, errno);
        bytes = bytes.subspan(static_cast<std::size_t>(put));
    }
}

/// Beside the file, so that the rename stays within one file system; its own for each process and
/// call, and short, however long the file's may be.
fs::path partial_name(const fs::path& file) {
    static std::atomic<unsigned> calls = 0;
    const std::string own = std::to_string(::getpid()) + "-" + std::to_string(calls++);
    return file.parent_path() / (".partial-" + own);
}

void write_whole(const fs::path& file, std::span<const std::byte> bytes) {
    std::error_code none;
    const fs::file_status before = fs::status(file, none);
    if (fs::exists(before) && !fs::is_regular_file(before))  // a device would be gone
        throw Error(ErrorCode::InvalidArgument,
                    "cannot write " + file.string() + ": it is " +
                        (fs::is_directory(before) ? "a folder" : "not a regular file"));
    const fs::path partial = partial_name(file);
    FileDescriptor fd(::open(partial.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
    if (fd.get() < 0) fail_io("cannot write", file, errno);
    try {
        write_all(fd.get(), bytes, file);
        if (::fsync(fd.get()) != 0) fail_io("cannot write", file, errno);
        if (fd.close() != 0) fail_io("cannot write", file, errno);
        if (::rename(partial.c_str(), file.c_str()) != 0) fail_io("cannot write", file, errno);
    } catch (...) {
        ::unlink(partial.c_str());
        throw;
    }
}

PointCloud decode(std::span<const std::byte> bytes, const DecodeLimits& limits,
                  const RunContext& context, DecodeReport& report) {
    if (report.format == CloudFormat::Ply) return decode_ply(bytes, limits, context, report);
    if (report.format == CloudFormat::Draco) return decode_draco(bytes, limits, context, report);
    PointCloud cloud = decode_progressive(bytes, limits, context);
    report.encoding = "progressive";
    report.points = cloud.size();
    return cloud;
}

}  // namespace

std::string_view to_string(CloudFormat format) noexcept {
    switch (format) {
        case CloudFormat::Ply:
            return "ply";
        case CloudFormat::Draco:
            return "drc";
        case CloudFormat::Progressive:
            return "stpc";
        case CloudFormat::Copc:
            return "copc.laz";
        case CloudFormat::Glb:
            break;
    }
    return "glb";
}

std::string_view media_type(CloudFormat format) noexcept {
    switch (format) {
        case CloudFormat::Ply:
            return "model/ply";
        case CloudFormat::Draco:
            return "model/vnd.google.draco";
        case CloudFormat::Progressive:
            return "application/vnd.stipple.progressive";
        case CloudFormat::Copc:
            return "application/vnd.laszip+copc";
        case CloudFormat::Glb:
            break;
    }
    return "model/gltf-binary";
}

CloudFormat cloud_format_from_name(std::string_view name) {
    if (name == "ply") return CloudFormat::Ply;
    if (name == "drc" || name == "draco") return CloudFormat::Draco;
    if (name == "glb") return CloudFormat::Glb;
    if (name == "stpc" || name == "stream") return CloudFormat::Progressive;
    if (name == "copc.laz" || name == "copc") return CloudFormat::Copc;
    throw Error(ErrorCode::UnsupportedFormat,
                "format " + in_quotes(name) +
                    ": expected ply, drc or, for a pyramid, glb, stpc or copc.laz");
}

std::optional<CloudFormat> detect_format(std::span<const std::byte> head) noexcept {
    const std::string_view text = as_text(head);
    if (text.starts_with("DRACO")) return CloudFormat::Draco;
    if (text.starts_with("STPC")) return CloudFormat::Progressive;
    const bool ply =
        text.starts_with("ply") && (text.size() == 3 || static_cast<unsigned char>(text[3]) <= ' ');
    return ply ? std::optional(CloudFormat::Ply) : std::nullopt;
}

CloudFormat check_head(std::span<const std::byte> head, std::uint64_t file_bytes,
                       const DecodeLimits& limits) {
    const CloudFormat format = format_of(head);
    if (format == CloudFormat::Ply) check_ply_head(head, file_bytes, limits);
    return format;
}

PointCloud decode_cloud(std::span<const std::byte> bytes, const DecodeLimits& limits,
                        const RunContext& context, DecodeReport* report) {
    DecodeReport local;
    local.format = format_of(bytes);
    context.checkpoint(0);
    PointCloud cloud = decode(bytes, limits, context, local);
    context.checkpoint(1);
    if (report != nullptr) *report = std::move(local);
    return cloud;
}

PointCloud read_cloud(const fs::path& file, const DecodeLimits& limits, const RunContext& context,
                      DecodeReport* report) {
    const FileBytes bytes(file);
    return decode_cloud(bytes.get(), limits, context, report);
}

std::vector<std::byte> encode_cloud(const PointCloud& cloud, const fs::path& file,
                                    const PlyEncodeOptions& ply, const DracoEncodeOptions& draco,
                                    const CopcOptions& copc, const RunContext& context) {
    std::string extension = file.extension().string();
    for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    if (extension == ".ply") return encode_ply(cloud, ply, context);
    if (extension == ".drc") return encode_draco(cloud, draco, context);
    if (extension == ".laz") return encode_copc(cloud, copc, context);
    if (extension == ".stpc")
        return encode_progressive(
            cloud, {.position_bits = draco.position_bits, .precision = draco.precision}, context);
    throw Error(ErrorCode::UnsupportedFormat, "cannot write " + file.string() + ": extension " +
                                                  in_quotes(extension) +
                                                  ", expected .ply, .drc, .stpc or .laz");
}

void write_cloud(const PointCloud& cloud, const fs::path& file, const PlyEncodeOptions& ply,
                 const DracoEncodeOptions& draco, const CopcOptions& copc,
                 const RunContext& context) {
    write_whole(file, encode_cloud(cloud, file, ply, draco, copc, context));
}

}  // namespace stipple
