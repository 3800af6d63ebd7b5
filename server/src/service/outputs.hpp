#pragma once

#include "service/links.hpp"
#include "service/output_cache.hpp"
#include "service/packer.hpp"
#include "store/job_store.hpp"

#include "stipple/proto/tiles.hpp"

#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>

namespace stipple::server {

/// Why a job that ended without success made no more; nothing of any other.
std::optional<proto::Problem> why_incomplete(const proto::JobDocument& job);

/// A file as it is sent.
struct StoredFile {
    std::variant<Bytes, std::shared_ptr<const BlobReader>> content;
    std::string tag;  ///< strong entity tag of these very bytes, without quotes
    Coding coding = Coding::Identity;
    bool negotiated = false;  ///< another client may get it packed otherwise

    std::uint64_t size() const noexcept;
};

/// Asked for before a document is written, which takes a second for the largest, and held until it
/// is. Throws where there is none, or where nobody waits for the document any more.
using Turn = std::function<std::shared_ptr<void>()>;

/// How a document of a pyramid is written.
struct DocumentOptions {
    /// Of the coarsest level, the file of this format is a `data:` URI in it, when it has at most
    /// 64 KiB: the first picture costs one request.
    std::optional<CloudFormat> inlined{};
    proto::TilesetOptions tileset{};
};

/// What jobs made, as it is sent: jobs that have ended are read from the store once, small files
/// and packed copies are kept in memory, and a request for a tile of a finished pyramid asks no
/// database. Bounded: 64 jobs that list 200,000 files, 64 MiB of files. Safe to call from any
/// thread.
class Outputs {
public:
    /// @param max_files  that the jobs list which are remembered: some 3 kB each
    Outputs(JobStore& jobs, BlobStore& blobs, Links links, std::size_t max_files = 200'000);

    /// Asks the packing of files to end. Whether it has within so long.
    bool end_packing(std::chrono::milliseconds patience) { return packer_.end(patience); }

    /// What a job made so far, with the links of its files; null when there is no such job.
    std::shared_ptr<const proto::Results> results(const std::string& tenant, const std::string& id);

    /// A file that a job lists, in the first coding of `accepted` that it has. Where it has none of
    /// them, and while its packed copies are still made, plain.
    /// @param name  its hash and the extension of its format. @throws Error(NotFound) when the job
    /// does not list it.
    StoredFile file(const std::string& tenant, const std::string& job_id, const std::string& name,
                    std::span<const Coding> accepted);

    /// `manifest.json`, `tileset.json` or another file of the tileset of a pyramid. The manifest of
    /// a job that ended without success says why, as `problem`. @throws Error(NotFound), and what
    /// `turn` throws.
    StoredFile document(const std::string& tenant, const std::string& job_id,
                        const std::string& name, std::span<const Coding> accepted,
                        const DocumentOptions& options = {}, const Turn& turn = {});

    /// The bytes of a listed file. @throws Error(Internal) when they are missing.
    std::shared_ptr<const BlobReader> open(const std::string& sha256) const;

    /// Bytes made for one reply, on disk while they are sent: a slow client holds no memory.
    std::shared_ptr<const BlobReader> hold(std::span<const std::byte> bytes) const {
        return blobs_.hold(bytes);
    }

    /// A level was published: its tiles are packed before the first client asks for them.
    void announce(const proto::OutputCloud& level);

private:
    struct Job;
    std::shared_ptr<const Job> find(const std::string& tenant, const std::string& id);
    std::shared_ptr<const Job> remembered(const std::string& key, const std::string& tenant,
                                          const std::string& id);
    std::shared_ptr<std::mutex> reading(const std::string& key);
    void forget_oldest();
    OutputCache::File plain_document(const Job& job, const std::string& name,
                                     const DocumentOptions& options,
                                     const std::function<void()>& begin);
    proto::Results with_coarsest_inside(proto::Results results, CloudFormat format) const;
    std::optional<OutputCache::File> packed(const std::string& sha256, Coding coding);

    JobStore& jobs_;
    BlobStore& blobs_;
    const Links links_;
    const std::size_t max_files_;
    OutputCache cache_;
    std::mutex recent_mutex_;  ///< for all three below
    std::map<std::string, std::shared_ptr<const Job>, std::less<>> recent_;
    std::map<std::string, std::weak_ptr<std::mutex>> reading_;  ///< held by who reads a job
    std::uint64_t uses_ = 0;
    Packer packer_;  ///< last: its threads tell the cache
};

}  // namespace stipple::server
