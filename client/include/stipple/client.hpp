#pragma once

#include "stipple/client_errors.hpp"
#include "stipple/proto/job.hpp"
#include "stipple/proto/results.hpp"
#include "stipple/proto/slice.hpp"

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

namespace stipple {

struct ClientOptions {
    std::string api_key{};   ///< sent as `Authorization: Bearer`; visible ASCII; empty: none
    std::stop_token stop{};  ///< ends a running call with `Cancelled`
    std::chrono::seconds timeout{30};  ///< longest silence of the server within a call
};

/// An event of a job, from the server's event stream.
struct ClientEvent {
    std::uint64_t id = 0;  ///< increasing; a later call resumes after it
    std::string type;      ///< `status`, `source`, `progress` or `level`
    std::string data;      ///< JSON, as described in openapi.yaml
};

/// A page of documents, newest first.
struct CloudPage {
    std::vector<proto::CloudDocument> items;
    std::optional<std::string> next;  ///< where the next page begins; absent on the last page
};

/// A client of a `stippled` server over HTTP.
///
///     stipple::Client client("http://127.0.0.1:8080");
///     const auto cloud = client.upload("scan.ply");
///     const auto job = client.submit({cloud.id, stipple::proto::SimplifyJob{{.points = 5000}, {}}});
///     if (client.wait(job.id).status == stipple::proto::JobStatus::Successful) …
///
/// Every call throws `Error`, with the code of the server's problem document; `Unreachable` if there
/// was no answer, with a sentence that names the address and the remedy; and `Cancelled` when
/// stopped. A call that may be repeated safely is tried up to four times, within seconds. `submit`
/// is one of them, because it sends an idempotency key; the upload of a file is not. Redirects are
/// never followed, so the API key goes only to the given address. Safe to call from several threads.
/// The client makes the program ignore SIGPIPE, which would otherwise end it when a server closes a
/// connection early.
class Client {
public:
    using ByteProgress = std::function<void(std::uint64_t done, std::uint64_t total)>;

    /// @param base_url  `http://HOST[:PORT][/PATH]` or `https://…`.
    /// @throws Error(InvalidArgument) for another form.
    ///
    /// Does not connect yet.
    explicit Client(std::string_view base_url, ClientOptions options = {});
    ~Client();
    Client(Client&&) noexcept;
    Client& operator=(Client&&) noexcept;

    /// Sends a PLY, Draco or `.stpc` file and its name, streamed from disk; sends nothing if the
    /// server has these bytes already.
    proto::CloudDocument upload(const std::filesystem::path& file,
                                const ByteProgress& progress = {});
    proto::CloudDocument cloud(const std::string& id);
    CloudPage clouds(const std::optional<std::string>& cursor = {});

    /// @param idempotency_key  the same key returns the same job; empty: random, for this call
    /// only.
    proto::JobDocument submit(const proto::JobRequest& request, std::string idempotency_key = {});
    proto::JobDocument job(const std::string& id);
    /// The document once the job has ended; waits by long polls, for as long as it takes.
    proto::JobDocument wait(const std::string& id);
    /// Follows a job until it has ended, and returns its document. Events lost with a connection
    /// are requested again; a server that was there is waited for longer than by other calls, a
    /// minute: it may start anew.
    /// @param after  only events with a larger id.
    proto::JobDocument follow(const std::string& id,
                              const std::function<void(const ClientEvent&)>& on_event,
                              std::uint64_t after = 0);
    /// The results of a job, or its results so far (`complete` false).
    /// @throws Error(Conflict) if it was dismissed.
    proto::Results results(const std::string& id);
    /// Downloads a file of a result to `destination`, completely and with the right hash, or not at
    /// all.
    void download(const proto::OutputFile& file, const std::filesystem::path& destination,
                  const ByteProgress& progress = {});
    /// Cuts a cloud from a finished pyramid, on the server, and downloads it to `destination`,
    /// completely or not at all, with the server's limits, not those of the options. Returns its
    /// description, without the bytes.
    /// @throws Error also for options out of range.
    proto::Slice slice(const std::string& pyramid_id, const proto::SliceOptions& options,
                       const std::filesystem::path& destination);
    /// Stops a job that waits or runs; a job that has ended is kept.
    void dismiss(const std::string& id);
    /// Removes a job that has ended, with its results; stops one that waits or runs.
    void remove(const std::string& id);
    /// `GET /v1/limits`: JSON as described in openapi.yaml.
    std::string limits();

private:
    class Implementation;
    std::unique_ptr<Implementation> implementation_;
};

}  // namespace stipple
