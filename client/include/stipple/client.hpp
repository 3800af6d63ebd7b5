#pragma once

#include "stipple/error.hpp"
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
    std::string api_key;   ///< sent as `Authorization: Bearer`; visible ASCII; empty: none
    std::stop_token stop;  ///< ends a call under way with `Cancelled`
    std::chrono::seconds timeout{30};  ///< longest silence of the server within a call
};

/// What happened to a job, as the server's event stream tells it.
struct ClientEvent {
    std::uint64_t id = 0;  ///< grows; where a later call resumes
    std::string type;      ///< `status`, `progress` or `level`
    std::string data;      ///< JSON, as openapi.yaml describes it
};

/// A page of documents, newest first.
struct CloudPage {
    std::vector<proto::CloudDocument> items;
    std::optional<std::string> next;  ///< where the next page begins; nothing after the last
};

/// The server wants an API key, or does not know the one that it got.
class Unauthorized : public Error {
public:
    explicit Unauthorized(const std::string& message)
        : Error(ErrorCode::InvalidArgument, message) {}
};

/// Asks a `stippled` server over HTTP.
///
///     stipple::Client client("http://127.0.0.1:8080");
///     const auto cloud = client.upload("scan.ply");
///     const auto job = client.submit({cloud.id, proto::SimplifyJob{{.points = 5000}, {}}});
///     if (client.wait(job.id).status == proto::JobStatus::Successful) …
///
/// Every call throws `Error`: with the code of the server's problem document, or, when no answer
/// came, with a sentence that names the address and the remedy; and `Cancelled` when stopped. A
/// call that may be repeated without harm is tried up to four times, within seconds; `submit` is
/// one of them, because it sends an idempotency key; the upload of a file is not. Redirects are
/// never followed, so that the API key goes to the address given and nowhere else. Safe to call
/// from several threads. A program that uses it ignores SIGPIPE, which a server that closes early
/// would end it by.
class Client {
public:
    using ByteProgress = std::function<void(std::uint64_t done, std::uint64_t total)>;

    /// @param base_url  `http://HOST[:PORT]` or `https://…`. @throws Error(InvalidArgument) for
    /// another form. Connects to nothing yet.
    explicit Client(std::string_view base_url, ClientOptions options = {});
    ~Client();
    Client(Client&&) noexcept;
    Client& operator=(Client&&) noexcept;

    /// Sends a PLY or Draco file and its name, streamed from the disk; nothing is sent when the
    /// server holds these bytes already.
    proto::CloudDocument upload(const std::filesystem::path& file,
                                const ByteProgress& progress = {});
    proto::CloudDocument cloud(const std::string& id);
    CloudPage clouds(const std::optional<std::string>& cursor = {});

    /// @param idempotency_key  the same key gives the same job; empty: drawn at random, for this
    /// call alone.
    proto::JobDocument submit(const proto::JobRequest& request, std::string idempotency_key = {});
    proto::JobDocument job(const std::string& id);
    /// The document once the job is final; asks by long polls, for as long as it takes.
    proto::JobDocument wait(const std::string& id);
    /// Follows a job until it is final, and returns its document. Events lost with a connection are
    /// asked for again.
    /// @param after  only events with a larger id.
    proto::JobDocument follow(const std::string& id,
                              const std::function<void(const ClientEvent&)>& on_event,
                              std::uint64_t after = 0);
    /// What a job made, or has made so far (`complete` false).
    proto::Results results(const std::string& id);
    /// Fetches a file of a result into `destination`, whole and with the right hash, or not at all.
    void download(const proto::OutputFile& file, const std::filesystem::path& destination,
                  const ByteProgress& progress = {});
    /// A cloud cut from a finished pyramid, on the server, into `destination`, whole or not at all.
    /// What was cut is told, without its bytes. @throws Error also for options out of range.
    proto::Slice slice(const std::string& pyramid_id, const proto::SliceOptions& options,
                       const std::filesystem::path& destination);
    /// Stops a job that waits or runs; one that is final stays as it is.
    void dismiss(const std::string& id);
    /// Removes a final job and its results; stops one that waits or runs.
    void remove(const std::string& id);
    /// `GET /v1/limits`: JSON as openapi.yaml describes it.
    std::string limits();

private:
    class Implementation;
    std::unique_ptr<Implementation> implementation_;
};

}  // namespace stipple
