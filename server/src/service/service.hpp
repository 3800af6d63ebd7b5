#pragma once

#include "service/output_cache.hpp"
#include "service/outputs.hpp"
#include "store/blob_store.hpp"
#include "store/job_store.hpp"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

namespace stipple::server {

/// The limits in force (`GET /v1/limits`).
struct Limits {
    std::uint64_t max_upload_bytes = 2ULL << 30;
    DecodeLimits decode;
    std::uint64_t max_job_memory_bytes = 4ULL << 30;
    std::uint64_t max_job_cpu_seconds = 15 * 60;
    std::uint64_t max_job_output_bytes = 8ULL << 30;
    QueueLimits queue;
    std::chrono::seconds retention{7 * 24 * 3600};         ///< of jobs after their end
    std::chrono::seconds cloud_retention{30 * 24 * 3600};  ///< after their last use
    std::chrono::seconds max_wait{60};                     ///< longest long poll

    /// The memory of a job on so many bytes and threads (0: one a processor): 1 GiB, 1,024 times
    /// the input and the stacks, at most `max_job_memory_bytes`. A cloud of any use needs less, and
    /// a file of 33 bytes that asks for everything is stopped before it has taken all of it.
    std::uint64_t memory_for(std::uint64_t input_bytes, unsigned threads) const noexcept {
        constexpr std::uint64_t kBase = 1ULL << 30;
        return std::min(max_job_memory_bytes, kBase + 1024 * input_bytes + stacks_of(threads));
    }
    /// What the stacks of so many threads of a job take; 0: one thread per processor.
    static std::uint64_t stacks_of(unsigned threads) noexcept {
        constexpr std::uint64_t kStack = (4ULL << 20) + (64ULL << 10);  // TBB's, and what guards it
        if (threads == 0) threads = std::thread::hardware_concurrency();
        return threads * kStack;
    }
};

/// Enough of the first bytes of an upload to hold the header of nearly every PLY file.
inline constexpr std::size_t kUploadHeadBytes = std::size_t{64} << 10;

/// What each route means: no requests and no replies; of HTTP only the addresses in `links`, of
/// JSON text only that of events. One object for all threads. Every call names the tenant; what is
/// another's is NotFound. All failures are `Error`.
class Service {
public:
    Service(Limits limits, JobStore& jobs, BlobStore& blobs, Links links = Links());

    const Limits& limits() const noexcept { return limits_; }
    const Links& links() const noexcept { return links_; }

    /// An upload: write the bytes, then `finish_upload`.
    std::unique_ptr<BlobWriter> begin_upload();
    /// Durable when it returns. @param head  the first bytes, at least `kUploadHeadBytes` or all:
    /// what `check_head` refuses of them is refused. @param name  for people; at most 1000 bytes,
    /// no control characters
    Submission<proto::CloudDocument> finish_upload(const std::string& tenant, BlobWriter& upload,
                                                   std::span<const std::byte> head,
                                                   const std::optional<std::string>& name);
    proto::CloudDocument cloud(const std::string& tenant, const std::string& id);
    Page<proto::CloudDocument> clouds(const std::string& tenant, unsigned limit,
                                      const std::optional<std::string>& cursor);
    std::shared_ptr<const BlobReader> cloud_content(const std::string& tenant,
                                                    const std::string& id);
    void remove_cloud(const std::string& tenant, const std::string& id);

    /// Validates, checks that the input is there, queues.
    Submission<proto::JobDocument> submit(const std::string& tenant,
                                          const proto::JobRequest& request,
                                          const std::optional<std::string>& idempotency_key);
    proto::JobDocument job(const std::string& tenant, const std::string& id);
    /// The document as soon as the job is final, or as it is after `wait` or when asked to stop.
    proto::JobDocument wait_for_job(const std::string& tenant, const std::string& id,
                                    std::chrono::milliseconds wait, std::stop_token stop);
    Page<proto::JobDocument> jobs(const std::string& tenant, const JobStore::JobFilter& filter,
                                  unsigned limit, const std::optional<std::string>& cursor);
    /// The document after it: `dismissed`, or as it last was when a finished job is removed.
    proto::JobDocument dismiss(const std::string& tenant, const std::string& id);
    /// The document of a job that is dismissed. @throws Error(Conflict) for one that has ended.
    proto::JobDocument cancel(const std::string& tenant, const std::string& id);
    struct JobEvents {
        std::vector<JobEvent> items;
        bool complete = false;  ///< the job has ended, and these are none: there will be no others
    };
    /// The next events after `after`; waits up to `wait` for the first of them.
    JobEvents events(const std::string& tenant, const std::string& id, std::uint64_t after,
                     std::chrono::milliseconds wait, std::stop_token stop);
    bool has_events(const std::string& tenant, const std::string& id, std::uint64_t after);
    /// Also of a running job: what is there so far, `complete` false. Links filled.
    std::shared_ptr<const proto::Results> results(const std::string& tenant, const std::string& id);
    /// The files of results, as they are sent.
    Outputs& outputs() noexcept { return outputs_; }

    JobStore::Counts counts() { return jobs_.counts(); }
    /// Database answers, blobs can be written. @throws Error(Internal) saying what cannot.
    void check_ready();

private:
    void fill_links(proto::JobDocument& job) const;
    void fill_links(JobEvent& event, const proto::JobDocument& job);
    proto::JobDocument with_links(proto::JobDocument job) const;
    proto::CloudDocument document_of(CloudRow row) const;

    const Limits limits_;
    JobStore& jobs_;
    BlobStore& blobs_;
    const Links links_;
    Outputs outputs_;
    std::mutex filling_;        ///< held while the links of a large event are filled in
    OutputCache large_events_;  ///< with their links
};

}  // namespace stipple::server
