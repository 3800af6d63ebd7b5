#include "stipple/client.hpp"

#include "base_url.hpp"
#include "event_stream.hpp"
#include "http_connection.hpp"
#include "stipple/proto/digest.hpp"
#include "stipple/proto/idempotency_key.hpp"

#include <unistd.h>
#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <condition_variable>
#include <fstream>
#include <functional>
#include <mutex>
#include <nlohmann/json.hpp>

namespace stipple {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using Seconds = std::chrono::duration<double>;

constexpr std::chrono::seconds kLongPoll{20}, kPauseWithoutStream{2};

/// Waits, and wakes up with `Cancelled` when asked to stop.
void pause(Seconds time, const std::stop_token& stop) {
    std::mutex mutex;
    std::condition_variable_any stopped;
    std::unique_lock lock(mutex);
    stopped.wait_for(lock, stop, time, [] { return false; });
    if (stop.stop_requested()) throw Cancelled();
}

/// Repeats what may be repeated: when no answer came, or the server asked for a little patience.
/// @param got_on  since the last attempt: it counts as the first again, and a server that was there
/// is waited for longer, a minute: it may start anew.
template <typename Call>
HttpReply with_retries(
    const std::stop_token& stop, Call&& call,
    const std::function<bool()>& got_on = [] { return false; }) {
    constexpr int kAttempts = 4, kAttemptsOnceThere = 10;
    constexpr Seconds kLongestPause{10.0}, kFirstPause{0.1};
    Seconds delay = kFirstPause;
    int attempts = kAttempts;
    for (int attempt = 1;; ++attempt, delay = std::min(4 * delay, kLongestPause)) {
        if (got_on()) {
            attempts = kAttemptsOnceThere;
            attempt = 1;
            delay = kFirstPause;
        }
        try {
            HttpReply reply = call();
            // 502 and 504 are a proxy's, whose server starts anew.
            constexpr std::array kBusy{429, 502, 503, 504};
            const bool busy = std::ranges::find(kBusy, reply.status) != kBusy.end();
            const Seconds asked(reply.retry_after.value_or(delay.count()));
            if (!busy || attempt == attempts || asked > kLongestPause) return reply;
            pause(std::max(asked, delay), stop);
        } catch (const Unreachable&) {
            if (attempt == attempts) throw;
            pause(delay, stop);
        }
    }
}

Error not_ours(const std::string& where) {
    return {ErrorCode::Internal, where + ": not the answer of a stippled server: is it one?"};
}

/// The reply, when it is a good one. @throws Error for what the server says, or for its not being
/// ours.
HttpReply expect_ok(HttpReply reply, const std::string& where) {
    if (reply.ok()) return reply;
    if (reply.content_type.starts_with("application/problem+json")) {
        const Error error = proto::error_from(proto::problem_from_json(reply.body));
        if (reply.status == 401) throw Unauthorized(error.what());
        throw error;
    }
    throw Error(ErrorCode::Internal, where + ": answered with status " +
                                         std::to_string(reply.status) +
                                         " and no problem document: is it a stippled server?");
}

/// The document in a reply. One that `read` refuses says something of the server, not of the file
/// or the job that the request was about.
template <typename Document>
Document document_of(const std::string& body, const std::string& where,
                     Document (*read)(std::string_view)) {
    try {
        return read(body);
    } catch (const Error&) {
        throw not_ours(where);
    }
}

/// A good reply that tells of a job.
void expect_document(HttpReply reply, const std::string& where) {
    const std::string body = expect_ok(std::move(reply), where).body;
    if (!json::accept(body)) throw not_ours(where);
}

/// Ids become part of a path: only what ids are made of may.
const std::string& checked_id(const std::string& id) {
    const bool hexadecimal = std::all_of(id.begin(), id.end(), [](char c) {
        return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f');
    });
    if (id.empty() || !hexadecimal)
        throw Error(ErrorCode::InvalidArgument,
                    "id '" + id + "': expected lower-case hexadecimal digits");
    return id;
}

/// Whatever it holds is kept from being read as more of the query.
std::string query_escaped(const std::string& text) {
    static constexpr char kDigits[] = "0123456789ABCDEF";
    std::string escaped;
    for (const char c : text) {
        const auto byte = static_cast<unsigned char>(c);
        if (std::isalnum(byte) != 0 || c == '-' || c == '_' || c == '.')
            escaped += c;
        else
            escaped += {'%', kDigits[byte >> 4], kDigits[byte & 15]};
    }
    return escaped;
}

/// What a server takes as the name of a cloud: that of the file, without control characters.
std::string cloud_name(const fs::path& file) {
    std::string name = file.filename().string();
    std::erase_if(name, [](char c) { return std::iscntrl(static_cast<unsigned char>(c)) != 0; });
    return name;
}

bool ends_the_job(const EventStreamParser::Event& event) {
    if (event.type != "status") return false;
    const json data = json::parse(event.data, nullptr, false);
    const auto status = data.is_object() ? data.find("status") : data.end();
    return status != data.end() && status->is_string() &&
           proto::is_final(proto::job_status_from_name(status->get<std::string>()));
}

/// A file that has its name only once it is whole.
class PartialFile {
public:
    explicit PartialFile(const fs::path& destination)
        : destination_(replaceable(destination)),
          partial_(destination.parent_path() / (".stipple-" + proto::random_hex(8))),
          stream_(partial_, std::ios::binary) {
        if (!stream_) fail("cannot be written here");
    }
    ~PartialFile() {
        std::error_code ignored;
        if (!kept_) fs::remove(partial_, ignored);
    }
    PartialFile(const PartialFile&) = delete;
    PartialFile& operator=(const PartialFile&) = delete;

    void restart() {
        stream_.close();
        stream_.open(partial_, std::ios::binary | std::ios::trunc);
    }
    void write(std::string_view bytes) {
        stream_.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
        if (!stream_) fail("cannot be written: is the disk full?");
    }
    void keep() {
        stream_.close();
        if (!stream_) fail("cannot be written: is the disk full?");
        fs::rename(partial_, destination_);
        kept_ = true;
    }

private:
    /// A device would be gone.
    static const fs::path& replaceable(const fs::path& file) {
        std::error_code none;
        const fs::file_status before = fs::status(file, none);
        if (fs::exists(before) && !fs::is_regular_file(before))
            throw Error(ErrorCode::InvalidArgument, file.string() + ": not a regular file");
        return file;
    }
    [[noreturn]] void fail(const char* why) const {
        std::error_code none;
        const fs::path folder = destination_.parent_path();
        const bool has_folder = folder.empty() || fs::is_directory(folder, none);
        throw Error(has_folder ? ErrorCode::Internal : ErrorCode::NotFound,
                    destination_.string() + ": " + (has_folder ? why : "no such folder"));
    }

    fs::path destination_, partial_;
    std::ofstream stream_;
    bool kept_ = false;
};

}  // namespace

class Client::Implementation {
public:
    Implementation(std::string_view base_url, const ClientOptions& options)
        : http_(parse_base_url(base_url), options.api_key, options.timeout, options.stop) {}

    std::string get(const std::string& path, std::chrono::seconds extra_time = {}) const {
        const HttpReply reply =
            with_retries(http_.stop_token(), [&] { return http_.get(path, extra_time); });
        return expect_ok(reply, where(path)).body;
    }

    template <typename Document>
    Document get_document(const std::string& path, Document (*read)(std::string_view),
                          std::chrono::seconds extra_time = {}) const {
        return document_of(get(path, extra_time), where(path), read);
    }

    std::string where(const std::string& path) const {
        const BaseUrl& url = http_.url();
        return url.origin() + url.on_host(path);
    }
    const HttpConnection& http() const { return http_; }

private:
    HttpConnection http_;
};

Client::Client(std::string_view base_url, ClientOptions options)
    : implementation_(std::make_unique<Implementation>(base_url, options)) {}
Client::~Client() = default;
Client::Client(Client&&) noexcept = default;
Client& Client::operator=(Client&&) noexcept = default;

proto::CloudDocument Client::upload(const fs::path& file, const ByteProgress& progress) {
    const HttpConnection& http = implementation_->http();
    // A pipe would be read to its end for its hash, and then be empty.
    if (fs::exists(file) && !fs::is_regular_file(file))
        throw Error(ErrorCode::InvalidArgument, file.string() + ": expected a regular file");
    const std::string id = proto::sha256_of_file(file);
    const auto cloud_in = [](const HttpReply& reply, const std::string& where) {
        return document_of(expect_ok(reply, where).body, where, proto::cloud_document_from_json);
    };
    const HttpReply known =
        with_retries(http.stop_token(), [&] { return http.get("/v1/clouds/" + id); });
    if (known.status != 404) return cloud_in(known, implementation_->where("/v1/clouds/" + id));

    const std::uint64_t bytes = fs::file_size(file);
    std::ifstream stream(file, std::ios::binary);
    const auto source = [&](std::uint64_t offset, char* buffer, std::size_t room) -> std::size_t {
        if (progress) progress(offset, bytes);
        stream.read(buffer, static_cast<std::streamsize>(room));
        return static_cast<std::size_t>(stream.gcount());
    };
    const HttpReply reply =
        http.post("/v1/clouds?name=" + query_escaped(cloud_name(file)), bytes, source);
    if (progress) progress(bytes, bytes);
    return cloud_in(reply, implementation_->where("/v1/clouds"));
}

proto::CloudDocument Client::cloud(const std::string& id) {
    return implementation_->get_document("/v1/clouds/" + checked_id(id),
                                         proto::cloud_document_from_json);
}

CloudPage Client::clouds(const std::optional<std::string>& cursor) {
    const std::string query = cursor ? "?cursor=" + query_escaped(*cursor) : "";
    const std::string where = implementation_->where("/v1/clouds");
    const json page = json::parse(implementation_->get("/v1/clouds" + query), nullptr, false);
    if (!page.is_object() || !page.contains("items") || !page["items"].is_array())
        throw not_ours(where);
    CloudPage clouds;
    for (const json& item : page["items"])
        clouds.items.push_back(document_of(item.dump(), where, proto::cloud_document_from_json));
    if (const auto next = page.find("next"); next != page.end() && next->is_string())
        clouds.next = next->get<std::string>();
    return clouds;
}

proto::JobDocument Client::submit(const proto::JobRequest& request, std::string idempotency_key) {
    if (idempotency_key.empty()) idempotency_key = proto::random_hex(16);
    proto::check_idempotency_key(idempotency_key);
    const HttpConnection& http = implementation_->http();
    const HttpHeaders headers = {{"Idempotency-Key", idempotency_key}};
    const std::string body = proto::to_json(request);
    const HttpReply reply =
        with_retries(http.stop_token(), [&] { return http.post("/v1/jobs", headers, body); });
    const std::string where = implementation_->where("/v1/jobs");
    return document_of(expect_ok(reply, where).body, where, proto::job_document_from_json);
}

proto::JobDocument Client::job(const std::string& id) {
    return implementation_->get_document("/v1/jobs/" + checked_id(id),
                                         proto::job_document_from_json);
}

proto::JobDocument Client::wait(const std::string& id) {
    const std::string path =
        "/v1/jobs/" + checked_id(id) + "?wait=" + std::to_string(kLongPoll.count());
    for (;;) {
        proto::JobDocument document =
            implementation_->get_document(path, proto::job_document_from_json, kLongPoll);
        if (proto::is_final(document.status)) return document;
    }
}

proto::JobDocument Client::follow(const std::string& id,
                                  const std::function<void(const ClientEvent&)>& on_event,
                                  std::uint64_t after) {
    const HttpConnection& http = implementation_->http();
    const std::string path = "/v1/jobs/" + checked_id(id) + "/events";
    bool final = false;
    const auto deliver = [&](const EventStreamParser::Event& event) {
        std::uint64_t number = 0;
        const char* const end = event.id.data() + event.id.size();
        if (std::from_chars(event.id.data(), end, number).ptr != end || number <= after) return;
        after = number;
        if (on_event) on_event({number, event.type, event.data});
        final = final || ends_the_job(event);
    };
    while (!final) {
        const std::uint64_t before = after;
        const auto listen = [&] {
            EventStreamParser parser(deliver);  // what a broken stream left unfinished comes again
            const HttpHeaders headers = {{"Accept", "text/event-stream"},
                                         {"Last-Event-ID", std::to_string(after)}};
            return http.get(path, headers, [&](std::string_view bytes) {
                parser.feed(bytes);
                return !final;
            });
        };
        std::uint64_t seen = after;
        const auto got_on = [&] { return std::exchange(seen, after) != after; };
        try {
            HttpReply reply = with_retries(http.stop_token(), listen, got_on);
            if (reply.status == 429 || reply.status == 503) {
                // Its places for streams are taken, as by many clients of one machine: the job goes
                // on, and tells the rest once there is a place or it has ended.
                if (proto::is_final(job(id).status)) break;
                pause(kPauseWithoutStream, http.stop_token());
                continue;
            }
            expect_ok(std::move(reply), implementation_->where(path));
        } catch (const Unreachable& error) {
            throw Unreachable(std::string(error.what()) + " (job " + id +
                              " may go on there: its results will be at " +
                              implementation_->where("/v1/jobs/" + id + "/results") + ")");
        }
        // A stream that ends with nothing new: the job is over, or the server is going down.
        if (!final && after == before) {
            if (proto::is_final(job(id).status)) break;
            pause(Seconds(0.25), http.stop_token());
        }
    }
    return job(id);
}

proto::Results Client::results(const std::string& id) {
    return implementation_->get_document("/v1/jobs/" + checked_id(id) + "/results",
                                         proto::results_from_json);
}

proto::Slice Client::slice(const std::string& pyramid_id, const proto::SliceOptions& options,
                           const fs::path& destination) {
    const HttpConnection& http = implementation_->http();
    const std::string path =
        "/v1/pyramids/" + checked_id(pyramid_id) + "/slice?" + proto::slice_query(options);
    PartialFile partial(destination);
    const auto fetch = [&] {
        partial.restart();
        return http.get(path, {}, [&](std::string_view bytes) {
            partial.write(bytes);
            return true;
        });
    };
    const HttpReply reply =
        expect_ok(with_retries(http.stop_token(), fetch), implementation_->where(path));
    const auto number = [&](std::string_view name) -> std::optional<double> {
        const auto text = reply.field(name);
        const json value = text ? json::parse(*text, nullptr, false) : json();
        return value.is_number() ? std::optional(value.get<double>()) : std::nullopt;
    };
    proto::Slice slice;
    slice.points = static_cast<std::uint64_t>(number("Stipple-Points").value_or(0));
    if (slice.points == 0) throw not_ours(implementation_->where(path));
    partial.keep();
    slice.level = static_cast<unsigned>(number("Stipple-Level").value_or(0));
    if (const auto text = reply.field("Stipple-Origin")) {
        const json place = json::parse('[' + std::string(*text) + ']', nullptr, false);
        const auto is_number = [](const json& value) { return value.is_number(); };
        if (place.size() == 3 && std::ranges::all_of(place, is_number))
            slice.origin = Vec3d(place[0], place[1], place[2]);
    }
    slice.error_mean = number("Stipple-Error-Mean");
    slice.error_max = number("Stipple-Error-Max");
    return slice;
}

void Client::download(const proto::OutputFile& file, const fs::path& destination,
                      const ByteProgress& progress) {
    if (!file.href.starts_with('/') || file.href.starts_with("//"))
        throw Error(ErrorCode::InvalidArgument,
                    "href '" + file.href + "': expected an absolute path on the server");
    const HttpConnection& http = implementation_->http();
    PartialFile partial(destination);
    std::string sha256;
    const auto fetch = [&] {
        proto::Sha256 hash;
        std::uint64_t received = 0;
        partial.restart();
        HttpReply reply = http.get(file.href, {}, [&](std::string_view bytes) {
            received += bytes.size();
            if (received > file.bytes) return false;  // not what was promised: the hash will say so
            hash.update(std::as_bytes(std::span(bytes)));
            partial.write(bytes);
            if (progress) progress(received, file.bytes);
            return true;
        });
        sha256 = hash.finish();
        return reply;
    };
    expect_ok(with_retries(http.stop_token(), fetch), implementation_->where(file.href));
    if (sha256 != file.sha256)
        throw Error(ErrorCode::Internal,
                    implementation_->where(file.href) +
                        ": the received bytes do not match the promised hash: try again");
    partial.keep();
}

void Client::dismiss(const std::string& id) {
    const std::string path = "/v1/jobs/" + checked_id(id) + "?only=unfinished";
    const HttpConnection& http = implementation_->http();
    HttpReply reply = with_retries(http.stop_token(), [&] { return http.remove(path); });
    constexpr int kEnded = 409;  // also by this request, when its first reply was lost
    if (reply.status != kEnded) expect_document(std::move(reply), implementation_->where(path));
}

void Client::remove(const std::string& id) {
    const std::string path = "/v1/jobs/" + checked_id(id);
    const HttpConnection& http = implementation_->http();
    unsigned attempts = 0;
    HttpReply reply = with_retries(http.stop_token(), [&] {
        ++attempts;
        return http.remove(path);
    });
    const bool gone = attempts > 1 && reply.status == 404;
    if (!gone) expect_document(std::move(reply), implementation_->where(path));
}

std::string Client::limits() {
    std::string limits = implementation_->get("/v1/limits");
    if (!json::accept(limits)) throw not_ours(implementation_->where("/v1/limits"));
    return limits;
}

}  // namespace stipple
