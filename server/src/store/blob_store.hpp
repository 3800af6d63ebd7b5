#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace stipple::server {

/// A blob being written. Gone without a trace unless committed.
class BlobWriter {
public:
    virtual ~BlobWriter() = default;
    /// @throws Error(TooLarge) above the limit given to `create`; proto::StorageFull.
    virtual void write(std::span<const std::byte> bytes) = 0;
    /// Makes the bytes durable under their SHA-256 (fsync, rename, fsync of the folder) and returns
    /// it. Once.
    virtual std::string commit() = 0;
    virtual std::uint64_t size() const noexcept = 0;
};

/// A blob that can be read; the file stays readable while this lives, even when the blob is
/// removed.
class BlobReader {
public:
    virtual ~BlobReader() = default;
    virtual std::uint64_t size() const noexcept = 0;
    /// Fills `out` from `offset`; returns how many bytes there were. Any thread.
    virtual std::size_t read(std::uint64_t offset, std::span<std::byte> out) const = 0;
    /// Where the bytes lie as a local file; of bytes that are held there is none.
    virtual std::filesystem::path path() const = 0;
};

/// All bytes of a blob. @throws Error(Internal) when there are fewer than its size.
std::vector<std::byte> read_all(const BlobReader& blob);

/// Bytes by the SHA-256 of what they are. Safe to call from any thread.
class BlobStore {
public:
    virtual ~BlobStore() = default;
    virtual std::unique_ptr<BlobWriter> create(std::uint64_t max_bytes) = 0;
    /// Moves a finished local file in (hash taken anew, never believed) and returns its id.
    virtual std::string adopt(const std::filesystem::path& file) = 0;
    /// The same for the files of a level, in their order. All are durable when it returns.
    virtual std::vector<std::string> adopt(std::span<const std::filesystem::path> files) = 0;
    /// Null when missing. What was changed behind our back is found out: @throws Error(Internal)
    /// when the bytes have another hash.
    virtual std::shared_ptr<const BlobReader> open(const std::string& sha256) const = 0;
    /// Keeps bytes that are no blob in a file without a name, for as long as the reader lives.
    virtual std::shared_ptr<const BlobReader> hold(std::span<const std::byte> bytes) const = 0;
    /// The ids of blobs last committed or adopted before `time`.
    virtual std::vector<std::string> older_than(
        std::chrono::system_clock::time_point time) const = 0;
    /// Removes a blob unless it was committed or adopted (again) at `time` or later. Whether it
    /// did.
    virtual bool remove_older(const std::string& sha256,
                              std::chrono::system_clock::time_point time) = 0;

    /// Keeps bytes that were made from a blob beside it, under a short name of letters and digits:
    /// they go when the blob goes. Does nothing when the blob is missing. Not durable: what is lost
    /// can be made again.
    virtual void put_copy(const std::string& sha256, std::string_view name,
                          std::span<const std::byte> bytes) = 0;
    /// What was kept, or nothing: also when it is damaged.
    virtual std::optional<std::vector<std::byte>> copy(const std::string& sha256,
                                                       std::string_view name) const = 0;
    virtual void remove_copy(const std::string& sha256, std::string_view name) = 0;

    /// Writes something small, durably. @throws Error(Internal) saying why it could not.
    virtual void probe() = 0;
    /// For what can be refused, so that there is always room for removals: @throws
    /// proto::StorageFull when the disk is full but for a small reserve. `write` of a blob asks the
    /// same.
    virtual void check_room() const = 0;
};

/// Blobs as files `<root>/ab/cd/<sha256>`, for any number of processes; copies as
/// `<sha256>.<name>` beside them: their bytes, and the 64 digits of the hash of these.
/// @param unfinished  folders in `root` that no other process uses: what a killed one left there is
/// removed, and files are written in the first before they get their names. None: for one who only
/// reads, and changes nothing.
std::unique_ptr<BlobStore> open_file_blob_store(const std::filesystem::path& root,
                                                const std::vector<std::string>& unfinished = {
                                                    "tmp"});

}  // namespace stipple::server
