#include "store/blob_store.hpp"

#include "store/data_folder.hpp"
#include "store/posix_file.hpp"
#include "store/verified_files.hpp"

#include "stipple/error.hpp"
#include "stipple/proto/digest.hpp"
#include "stipple/proto/problem.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>
#include <algorithm>
#include <cerrno>
#include <deque>
#include <mutex>

namespace stipple::server {

namespace {

namespace fs = std::filesystem;
using std::chrono::system_clock;

constexpr std::size_t kBlock = 1 << 20;
constexpr std::size_t kHashDigits = 64;
/// From so many files on the whole file system is synced: four syncs for each take longer then.
constexpr std::size_t kManyFiles = 16;

struct stat status_of(const FileDescriptor& fd, const fs::path& file) {
    struct stat status {};
    if (::fstat(fd.get(), &status) != 0) throw_errno("cannot stat", file);
    return status;
}

std::string hash_of(const FileDescriptor& fd, const fs::path& file) {
    proto::Sha256 hash;
    std::vector<std::byte> block(kBlock);
    std::uint64_t offset = 0;
    while (const std::size_t n = read_at(fd, offset, block, file)) {
        hash.update({block.data(), n});
        offset += n;
    }
    return hash.finish();
}

/// To another file system. Not by the standard library, which does not say that a disk is full.
void copy_plain_file(const fs::path& from, const fs::path& to) {
    const FileDescriptor in = open_file(from, O_RDONLY | O_NOFOLLOW | O_NONBLOCK);
    if (!in) throw_errno("cannot open", from);
    if (!S_ISREG(status_of(in, from).st_mode))
        throw Error(ErrorCode::Internal, from.string() + ": not a plain file");
    const FileDescriptor out = open_file(to, O_WRONLY | O_CREAT | O_EXCL);
    if (!out) throw_errno("cannot create", to);
    std::vector<std::byte> block(kBlock);
    std::uint64_t offset = 0;
    while (const std::size_t n = read_at(in, offset, block, from)) {
        write_all(out, std::span(block).first(n), to);
        offset += n;
    }
}

/// Read-only, and as old as the commit.
void protect(const FileDescriptor& fd, const fs::path& file) {
    if (::fchmod(fd.get(), 0440) != 0) throw_errno("cannot protect", file);
    const timespec now[2] = {{0, UTIME_NOW}, {0, UTIME_NOW}};
    if (::futimens(fd.get(), now) != 0) throw_errno("cannot touch", file);
}

system_clock::time_point committed_at(const struct stat& status) {
    const auto since_epoch = std::chrono::seconds(status.st_mtim.tv_sec) +
                             std::chrono::nanoseconds(status.st_mtim.tv_nsec);
    return system_clock::time_point(
        std::chrono::duration_cast<system_clock::duration>(since_epoch));
}

class FileBlobReader final : public BlobReader {
public:
    FileBlobReader(FileDescriptor fd, std::uint64_t size, fs::path file)
        : fd_(std::move(fd)), size_(size), file_(std::move(file)) {}

    std::uint64_t size() const noexcept override { return size_; }
    std::size_t read(std::uint64_t offset, std::span<std::byte> out) const override {
        return read_at(fd_, offset, out, file_);
    }
    fs::path path() const override { return file_; }

private:
    const FileDescriptor fd_;
    const std::uint64_t size_;
    const fs::path file_;
};

/// A name in the folder for unfinished files; the file is removed unless it was moved away.
class TemporaryName {
public:
    explicit TemporaryName(const fs::path& folder) : path_(folder / proto::random_hex(16)) {}
    TemporaryName(const TemporaryName&) = delete;
    TemporaryName& operator=(const TemporaryName&) = delete;
    ~TemporaryName() {
        std::error_code ignored;
        if (!moved_) fs::remove(path_, ignored);
    }
    const fs::path& path() const noexcept { return path_; }
    void moved() noexcept { moved_ = true; }

private:
    const fs::path path_;
    bool moved_ = false;
};

/// Held while a blob gets its name or loses it, so that none is removed that was committed again
/// just now, be it by another process.
class NamesLock {
public:
    explicit NamesLock(const fs::path& root) {
        std::error_code failure;
        fs::create_directories(root, failure);
        folder_ = open_file(root, O_RDONLY | O_DIRECTORY);
        if (!folder_) throw_errno("cannot use as a store of blobs", root);
    }
    void lock() {
        mutex_.lock();  // threads of this process share the folder's lock
        while (::flock(folder_.get(), LOCK_EX) != 0 && errno == EINTR) {
        }
    }
    void unlock() {
        ::flock(folder_.get(), LOCK_UN);
        mutex_.unlock();
    }

private:
    std::mutex mutex_;
    FileDescriptor folder_;
};

class FileBlobStore final : public BlobStore {
public:
    FileBlobStore(const fs::path& root, const std::vector<std::string>& unfinished);

    std::unique_ptr<BlobWriter> create(std::uint64_t max_bytes) override;
    std::string adopt(const fs::path& file) override;
    std::vector<std::string> adopt(std::span<const fs::path> files) override;
    std::shared_ptr<const BlobReader> open(const std::string& sha256) const override;
    std::shared_ptr<const BlobReader> hold(std::span<const std::byte> bytes) const override;
    std::vector<std::string> older_than(system_clock::time_point time) const override;
    bool remove_older(const std::string& sha256, system_clock::time_point time) override;
    void put_copy(const std::string& sha256, std::string_view name,
                  std::span<const std::byte> bytes) override;
    std::optional<std::vector<std::byte>> copy(const std::string& sha256,
                                               std::string_view name) const override;
    void remove_copy(const std::string& sha256, std::string_view name) override;
    void probe() override;
    void check_room() const override;

    /// Gives a whole, written file its name for good.
    void publish(const FileDescriptor& fd, TemporaryName& temporary, const std::string& sha256);
    const fs::path& temporary_folder() const noexcept { return temporary_folder_; }

private:
    fs::path folder_of(const std::string& sha256) const {
        return root_ / sha256.substr(0, 2) / sha256.substr(2, 2);
    }
    fs::path file_of(const std::string& sha256) const { return folder_of(sha256) / sha256; }
    fs::path copy_of(const std::string& sha256, std::string_view name) const {
        return folder_of(sha256) / (sha256 + "." + std::string(name));
    }
    FileDescriptor take_over(const fs::path& file, const TemporaryName& temporary) const;
    void name(TemporaryName& temporary, const std::string& sha256);

    const fs::path root_, temporary_folder_;
    NamesLock names_;
    mutable VerifiedFiles verified_;
};

class FileBlobWriter final : public BlobWriter {
public:
    FileBlobWriter(FileBlobStore& store, std::uint64_t max_bytes)
        : store_(store), max_bytes_(max_bytes), temporary_(store.temporary_folder()) {
        fd_ = open_file(temporary_.path(), O_RDWR | O_CREAT | O_EXCL);
        if (!fd_) throw_errno("cannot create", temporary_.path());
    }

    void write(std::span<const std::byte> bytes) override {
        if (size_ >= looked_at_) {
            store_.check_room();
            looked_at_ = size_ + kBlock;
        }
        if (bytes.size() > max_bytes_ - size_) {
            throw Error(ErrorCode::TooLarge, "more than " + std::to_string(max_bytes_) +
                                                 " bytes: the limit for one upload; send fewer "
                                                 "points or a compressed format");
        }
        write_all(fd_, bytes, temporary_.path());
        hash_.update(bytes);
        size_ += bytes.size();
    }

    std::string commit() override {
        std::string sha256 = hash_.finish();
        store_.publish(fd_, temporary_, sha256);
        return sha256;
    }

    std::uint64_t size() const noexcept override { return size_; }

private:
    FileBlobStore& store_;
    const std::uint64_t max_bytes_;
    TemporaryName temporary_;
    FileDescriptor fd_;
    proto::Sha256 hash_;
    std::uint64_t size_ = 0;
    std::uint64_t looked_at_ = 0;  ///< size at which the room is looked at again
};

FileBlobStore::FileBlobStore(const fs::path& root, const std::vector<std::string>& unfinished)
    : root_(root),
      temporary_folder_(root / (unfinished.empty() ? "tmp" : unfinished.front())),
      names_(root) {
    try {
        // What lies there was never acknowledged.
        for (const std::string& folder : unfinished) clear_leftovers(root / folder);
    } catch (const fs::filesystem_error& failure) {
        throw Error(ErrorCode::Internal, "cannot use " + root.string() +
                                             " as a store of blobs: " + failure.code().message());
    }
    if (!unfinished.empty()) sync_folder(root_);
}

std::unique_ptr<BlobWriter> FileBlobStore::create(std::uint64_t max_bytes) {
    return std::make_unique<FileBlobWriter>(*this, max_bytes);
}

void FileBlobStore::publish(const FileDescriptor& fd, TemporaryName& temporary,
                            const std::string& sha256) {
    protect(fd, temporary.path());
    sync_file(fd, temporary.path());
    name(temporary, sha256);
    const fs::path folder = folder_of(sha256);
    sync_folder(folder);
    sync_folder(folder.parent_path());
    sync_folder(root_);
}

void FileBlobStore::name(TemporaryName& temporary, const std::string& sha256) {
    const std::lock_guard lock(names_);
    const fs::path folder = folder_of(sha256);
    std::error_code failure;
    fs::create_directories(folder, failure);
    if (failure) {
        errno = failure.value();
        throw_errno("cannot create", folder);
    }
    // A blob that is there already is replaced by the same bytes, freshly checked: that mends a
    // damaged one and makes it young again. Who reads the old one keeps it.
    const fs::path file = folder / sha256;
    if (::rename(temporary.path().c_str(), file.c_str()) != 0) throw_errno("cannot name", file);
    temporary.moved();
    struct stat status {};
    if (::stat(file.c_str(), &status) != 0) throw_errno("cannot stat", file);
    verified_.add(sha256, status);
}

FileDescriptor FileBlobStore::take_over(const fs::path& file,
                                        const TemporaryName& temporary) const {
    // Moved before it is looked at: whoever made it can no longer put another file in its place.
    if (::rename(file.c_str(), temporary.path().c_str()) != 0) {
        if (errno != EXDEV) throw_errno("cannot take over", file);
        copy_plain_file(file, temporary.path());
        fs::remove(file);
    }
    FileDescriptor fd = open_file(temporary.path(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK);
    if (!fd) throw_errno("cannot open", file);
    const struct stat status = status_of(fd, file);
    if (!S_ISREG(status.st_mode) || status.st_nlink != 1) {
        throw Error(ErrorCode::Internal, file.string() + ": not a plain file with one name");
    }
    return fd;
}

std::string FileBlobStore::adopt(const fs::path& file) {
    TemporaryName temporary(temporary_folder());
    const FileDescriptor fd = take_over(file, temporary);
    std::string sha256 = hash_of(fd, file);
    publish(fd, temporary, sha256);
    return sha256;
}

std::vector<std::string> FileBlobStore::adopt(std::span<const fs::path> files) {
    std::vector<std::string> ids;
    if (files.size() < kManyFiles) {
        for (const fs::path& file : files) ids.push_back(adopt(file));
        return ids;
    }
    std::deque<TemporaryName> taken;
    for (const fs::path& file : files) {
        const FileDescriptor fd = take_over(file, taken.emplace_back(temporary_folder()));
        ids.push_back(hash_of(fd, file));
        protect(fd, file);
    }
    // The bytes before the names: one that is there already keeps its good bytes in a power cut.
    sync_file_system(root_);
    for (std::size_t i = 0; i < ids.size(); ++i) name(taken[i], ids[i]);
    sync_file_system(root_);
    return ids;
}

std::shared_ptr<const BlobReader> FileBlobStore::open(const std::string& sha256) const {
    if (!proto::is_sha256(sha256)) return nullptr;
    const fs::path file = file_of(sha256);
    FileDescriptor fd = open_file(file, O_RDONLY | O_NOFOLLOW);
    if (!fd && errno == ENOENT) return nullptr;
    if (!fd) throw_errno("cannot open", file);

    const struct stat status = status_of(fd, file);
    if (!verified_.contains(sha256, status)) {
        if (hash_of(fd, file) != sha256) {
            throw Error(ErrorCode::Internal,
                        "blob " + sha256 + " is damaged: its bytes have another hash");
        }
        verified_.add(sha256, status);
    }
    return std::make_shared<FileBlobReader>(std::move(fd),
                                            static_cast<std::uint64_t>(status.st_size), file);
}

std::vector<std::string> FileBlobStore::older_than(system_clock::time_point time) const {
    std::vector<std::string> names;
    // A disk that is mounted there may have folders of its own, as `lost+found`.
    constexpr auto kOwnOnly = fs::directory_options::skip_permission_denied;
    for (const fs::directory_entry& file : fs::recursive_directory_iterator(root_, kOwnOnly)) {
        std::string name = file.path().filename().string();
        struct stat status {};
        if (!proto::is_sha256(name) || ::stat(file.path().c_str(), &status) != 0) continue;
        if (committed_at(status) < time) names.push_back(std::move(name));
    }
    return names;
}

bool FileBlobStore::remove_older(const std::string& sha256, system_clock::time_point time) {
    if (!proto::is_sha256(sha256)) return false;
    const fs::path file = file_of(sha256);
    const std::lock_guard lock(names_);
    struct stat status {};
    if (::stat(file.c_str(), &status) != 0 || committed_at(status) >= time) return false;
    // Its packed copies first: nobody would look for those of a blob that is gone.
    for (const fs::directory_entry& entry : fs::directory_iterator(file.parent_path())) {
        if (entry.path().stem() == sha256 && entry.path() != file) fs::remove(entry.path());
    }
    if (::unlink(file.c_str()) != 0) throw_errno("cannot remove", file);
    verified_.remove(sha256);
    return true;
}

std::shared_ptr<const BlobReader> FileBlobStore::hold(std::span<const std::byte> bytes) const {
    const TemporaryName temporary(temporary_folder());
    FileDescriptor fd = open_file(temporary.path(), O_RDWR | O_CREAT | O_EXCL);
    if (!fd) throw_errno("cannot create", temporary.path());
    write_all(fd, bytes, temporary.path());
    return std::make_shared<FileBlobReader>(std::move(fd), bytes.size(), temporary.path());
}

void FileBlobStore::put_copy(const std::string& sha256, std::string_view name,
                             std::span<const std::byte> bytes) {
    const TemporaryName temporary(temporary_folder());
    const FileDescriptor fd = open_file(temporary.path(), O_WRONLY | O_CREAT | O_EXCL);
    if (!fd) throw_errno("cannot create", temporary.path());
    write_all(fd, bytes, temporary.path());
    const std::string hash = proto::sha256_hex(bytes);
    write_all(fd, std::as_bytes(std::span(hash)), temporary.path());

    const std::lock_guard lock(names_);
    struct stat status {};
    if (::stat(file_of(sha256).c_str(), &status) != 0) return;
    const fs::path file = copy_of(sha256, name);
    if (::rename(temporary.path().c_str(), file.c_str()) != 0) throw_errno("cannot name", file);
}

std::optional<std::vector<std::byte>> FileBlobStore::copy(const std::string& sha256,
                                                          std::string_view name) const {
    const fs::path file = copy_of(sha256, name);
    const FileDescriptor fd = open_file(file, O_RDONLY | O_NOFOLLOW);
    if (!fd) return std::nullopt;
    std::vector<std::byte> bytes(static_cast<std::size_t>(status_of(fd, file).st_size));
    if (bytes.size() < kHashDigits || read_at(fd, 0, bytes, file) != bytes.size())
        return std::nullopt;
    const std::span whole(bytes);
    const std::string hash = proto::sha256_hex(whole.first(bytes.size() - kHashDigits));
    if (!std::ranges::equal(whole.last(kHashDigits), std::as_bytes(std::span(hash))))
        return std::nullopt;
    bytes.resize(bytes.size() - kHashDigits);
    return bytes;
}

void FileBlobStore::remove_copy(const std::string& sha256, std::string_view name) {
    std::error_code ignored;
    fs::remove(copy_of(sha256, name), ignored);
}

void FileBlobStore::probe() {
    const TemporaryName temporary(temporary_folder());
    const FileDescriptor fd = open_file(temporary.path(), O_WRONLY | O_CREAT | O_EXCL);
    if (!fd) throw_errno("cannot create", temporary.path());
    write_all(fd, std::as_bytes(std::span("probe")), temporary.path());
    sync_file(fd, temporary.path());
}

void FileBlobStore::check_room() const {
    constexpr std::uint64_t kReserve = 64ULL << 20U;
    constexpr std::uint64_t kShareOfSmallDisk = 16;
    struct statvfs disk {};
    if (::statvfs(root_.c_str(), &disk) != 0) return;  // who writes next finds out
    const std::uint64_t free = std::uint64_t{disk.f_bavail} * disk.f_frsize;
    const std::uint64_t all = std::uint64_t{disk.f_blocks} * disk.f_frsize;
    const std::uint64_t reserve = std::min(kReserve, all / kShareOfSmallDisk);
    constexpr std::uint64_t kFewFiles = 64;
    const bool counts_files = disk.f_files > 0;  // not every file system does
    if (counts_files &&
        disk.f_favail < std::min<std::uint64_t>(kFewFiles, disk.f_files / kShareOfSmallDisk))
        throw proto::StorageFull("no more files can be made in " + root_.string() +
                                 ": the file system has no room for their names");
    if (free >= reserve) return;
    throw proto::StorageFull(std::to_string(free) + " bytes are free for " + root_.string() +
                             ": the last " + std::to_string(reserve) + " are kept for removals");
}

}  // namespace

std::unique_ptr<BlobStore> open_file_blob_store(const fs::path& root,
                                                const std::vector<std::string>& unfinished) {
    return std::make_unique<FileBlobStore>(root, unfinished);
}

}  // namespace stipple::server
