#include "cli/bucket.hpp"

#include "cli/curl.hpp"
#include "stipple/error.hpp"
#include "stipple/proto/digest.hpp"
#include "stipple/run_context.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <deque>
#include <memory>
#include <vector>

namespace stipple::cli {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr std::size_t kAtOnce = 8;
constexpr unsigned kMostTries = 4;
constexpr std::uint64_t kLargest = std::uint64_t{5} << 30;

struct FreeText {
    void operator()(char* text) const { curl().free(text); }
};
struct FreeList {
    void operator()(curl_slist* list) const { curl().slist_free_all(list); }
};
struct CloseFile {
    void operator()(std::FILE* file) const { static_cast<void>(std::fclose(file)); }
};
struct CloseEasy {
    void operator()(CURL* easy) const { curl().easy_cleanup(easy); }
};
struct CloseMulti {
    void operator()(CURLM* multi) const { curl().multi_cleanup(multi); }
};

template <typename T>
T required(T pointer) {
    if (pointer == nullptr) throw std::bad_alloc();
    return pointer;
}

/// Percent-encoded but for slashes.
std::string encoded(std::string_view key) {
    constexpr std::string_view kSlash = "%2F";
    const std::unique_ptr<char, FreeText> all(
        required(curl().easy_escape(nullptr, key.data(), static_cast<int>(key.size()))));
    std::string text(all.get());
    for (std::size_t at = text.find(kSlash); at != text.npos; at = text.find(kSlash, at))
        text.replace(at, kSlash.size(), "/");
    return text;
}

/// What stands between `<name>` and its end in a reply, if it does. No parser is needed: an error
/// of S3 is flat, its elements have no attributes, and what is found is only shown.
std::string element(std::string_view xml, std::string_view name) {
    const std::string open = "<" + std::string(name) + ">", close = "</" + std::string(name) + ">";
    const std::size_t from = xml.find(open);
    if (from == xml.npos) return {};
    const std::size_t to = xml.find(close, from);
    return std::string(
        xml.substr(from + open.size(), to == xml.npos ? 0 : to - from - open.size()));
}

/// A signed request for an object.
class Request {
public:
    /// @param sha256  of the body.
    Request(const BucketAccess& access, const std::string& url, const std::string& sha256)
        : easy_(required(curl().easy_init())) {
        add_header("x-amz-content-sha256: " + sha256);
        if (!access.session_token.empty())
            add_header("x-amz-security-token: " + access.session_token);
        const std::string sign = "aws:amz:" + access.region + ":s3";
        const std::string keys = access.key_id + ":" + access.secret;
        set(CURLOPT_URL, url.c_str());
        set(CURLOPT_PROTOCOLS_STR, "http,https");
        set(CURLOPT_AWS_SIGV4, sign.c_str());
        set(CURLOPT_USERPWD, keys.c_str());
        set(CURLOPT_WRITEFUNCTION, &keep_reply);
        set(CURLOPT_WRITEDATA, this);
        set(CURLOPT_ERRORBUFFER, failure_.data());
        set(CURLOPT_CONNECTTIMEOUT, 20L);
        set(CURLOPT_LOW_SPEED_LIMIT, 1L);  // nothing for a minute
        set(CURLOPT_LOW_SPEED_TIME, 60L);
        set(CURLOPT_NOSIGNAL, 1L);
    }
    Request(const Request&) = delete;
    Request& operator=(const Request&) = delete;

    CURL* easy() const noexcept { return easy_.get(); }
    template <typename Value>
    void set(CURLoption option, Value value) {
        const CURLcode code = curl().easy_setopt(easy_.get(), option, value);
        if (code != CURLE_OK) throw Error(ErrorCode::Internal, curl().easy_strerror(code));
    }
    void add_header(const std::string& line) {
        curl_slist* const longer = required(curl().slist_append(headers_.get(), line.c_str()));
        static_cast<void>(headers_.release());  // it is in the longer one
        headers_.reset(longer);
        set(CURLOPT_HTTPHEADER, longer);
    }

    // Once it has ended.

    bool succeeded(CURLcode code) const { return code == CURLE_OK && status() / 100 == 2; }
    /// Whether what went wrong may be gone by the next time.
    bool may_pass(CURLcode code) const {
        return code != CURLE_OK || status() >= 500 || status() == 429 || status() == 408;
    }
    std::string reason() const { return element(reply_, "Code"); }
    Error error(CURLcode code, const std::string& about) const {
        if (code != CURLE_OK) {
            const std::string what =
                failure_[0] != 0 ? failure_.data() : curl().easy_strerror(code);
            return {ErrorCode::Internal, about + ": " + what};
        }
        std::string what = reason();
        if (const std::string message = element(reply_, "Message"); !message.empty())
            what += (what.empty() ? "" : ": ") + message;
        return {may_pass(code) ? ErrorCode::Internal : ErrorCode::InvalidArgument,
                about + ": the store answers " + std::to_string(status()) +
                    (what.empty() ? "" : ", " + what)};
    }

private:
    long status() const {
        long status = 0;
        curl().easy_getinfo(easy_.get(), CURLINFO_RESPONSE_CODE, &status);
        return status;
    }

    static std::size_t keep_reply(const char* bytes, std::size_t size, std::size_t count,
                                  void* self) {
        constexpr std::size_t kMost = 16'384;
        std::string& reply = static_cast<Request*>(self)->reply_;
        reply.append(bytes, std::min(size * count, kMost - std::min(kMost, reply.size())));
        return size * count;
    }

    std::unique_ptr<curl_slist, FreeList> headers_;
    std::array<char, CURL_ERROR_SIZE> failure_{};
    std::string reply_;
    std::unique_ptr<CURL, CloseEasy> easy_;
};

/// One try to put one object.
struct Transfer {
    const BucketObject& object;
    unsigned tries;
    std::unique_ptr<std::FILE, CloseFile> file;
    Request request;

    Transfer(const BucketAddress& bucket, const BucketAccess& access, const BucketObject& object_,
             unsigned tries_before)
        : object(object_),
          tries(tries_before + 1),
          file(std::fopen(object.file.c_str(), "rb")),
          request(access, object_url(bucket, access, bucket.prefix + object.key),
                  proto::sha256_of_file(object.file)) {
        if (file == nullptr)
            throw Error(ErrorCode::Internal, object.file.string() + ": cannot be read");
        const std::uint64_t bytes = fs::file_size(object.file);
        if (bytes > kLargest)
            throw Error(
                ErrorCode::InvalidArgument,
                object.key + ": " + std::to_string(bytes) +
                    " bytes: one upload takes at most 5 GiB; write to a folder and copy it");
        request.add_header("Content-Type: " + object.media_type);
        request.add_header("Cache-Control: " + object.cache_control);
        request.set(CURLOPT_UPLOAD, 1L);
        request.set(CURLOPT_READDATA, file.get());
        request.set(CURLOPT_INFILESIZE_LARGE, static_cast<curl_off_t>(bytes));
    }

    std::uint64_t bytes_sent() const {
        curl_off_t bytes = 0;
        curl().easy_getinfo(request.easy(), CURLINFO_SIZE_UPLOAD_T, &bytes);
        return static_cast<std::uint64_t>(bytes);
    }
};

/// All transfers that are under way.
class Transfers {
public:
    Transfers() : multi_(required(curl().multi_init())) {}
    ~Transfers() {
        for (const auto& transfer : running_)
            curl().multi_remove_handle(multi_.get(), transfer->request.easy());
    }
    Transfers(const Transfers&) = delete;
    Transfers& operator=(const Transfers&) = delete;

    std::size_t size() const noexcept { return running_.size(); }
    void begin(std::unique_ptr<Transfer> transfer) {
        curl().multi_add_handle(multi_.get(), transfer->request.easy());
        running_.push_back(std::move(transfer));
    }

    /// Goes on for a moment. @param on_end  called with each transfer that has ended.
    template <typename OnEnd>
    void go_on(OnEnd&& on_end) {
        constexpr int kMoment = 100;  // ms
        int left = 0;
        check(curl().multi_perform(multi_.get(), &left));
        check(curl().multi_poll(multi_.get(), nullptr, 0, kMoment, nullptr));
        while (const CURLMsg* const message = curl().multi_info_read(multi_.get(), &left)) {
            if (message->msg != CURLMSG_DONE) continue;
            const CURLcode code = message->data.result;
            const auto ended = std::ranges::find(running_, message->easy_handle,
                                                 [](const auto& t) { return t->request.easy(); });
            curl().multi_remove_handle(multi_.get(), message->easy_handle);
            const std::unique_ptr<Transfer> transfer = std::move(*ended);
            running_.erase(ended);
            on_end(*transfer, code);
        }
    }

    std::uint64_t bytes_sent() const {
        std::uint64_t bytes = 0;
        for (const auto& transfer : running_) bytes += transfer->bytes_sent();
        return bytes;
    }

private:
    static void check(CURLMcode code) {
        if (code != CURLM_OK) throw Error(ErrorCode::Internal, curl().multi_strerror(code));
    }

    std::unique_ptr<CURLM, CloseMulti> multi_;
    std::vector<std::unique_ptr<Transfer>> running_;
};

/// An object that waits for its next try.
struct Waiting {
    const BucketObject* object;
    unsigned tries = 0;
    Clock::time_point not_before{};
};

std::string value_of(const std::function<const char*(const char*)>& variable,
                     std::initializer_list<const char*> names) {
    for (const char* const name : names) {
        const char* const value = variable(name);
        if (value != nullptr && *value != '\0') return value;
    }
    return {};
}

}  // namespace

std::optional<BucketAddress> bucket_address(std::string_view text) {
    constexpr std::string_view kScheme = "s3://";
    if (!text.starts_with(kScheme)) return std::nullopt;
    const std::string_view path = text.substr(kScheme.size());
    const std::size_t slash = std::min(path.find('/'), path.size());
    BucketAddress address{std::string(path.substr(0, slash))};
    const bool is_name = std::ranges::all_of(address.name, [](char c) {
        return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' || c == '.';
    });
    if (!is_name || address.name.size() < 3 || address.name.size() > 63)
        throw Error(ErrorCode::InvalidArgument,
                    std::string(text) +
                        ": expected s3://BUCKET/PREFIX, BUCKET being 3 to 63 lower-case letters, "
                        "digits, hyphens and dots");
    address.prefix = path.substr(std::min(slash + 1, path.size()));
    if (!address.prefix.empty() && !address.prefix.ends_with('/')) address.prefix += '/';
    return address;
}

BucketAccess bucket_access(const std::function<const char*(const char*)>& variable) {
    BucketAccess access;
    access.key_id = value_of(variable, {"AWS_ACCESS_KEY_ID"});
    access.secret = value_of(variable, {"AWS_SECRET_ACCESS_KEY"});
    for (const auto& [value, name] : {std::pair{&access.key_id, "AWS_ACCESS_KEY_ID"},
                                      std::pair{&access.secret, "AWS_SECRET_ACCESS_KEY"}}) {
        if (value->empty())
            throw Error(ErrorCode::InvalidArgument,
                        std::string("a bucket needs keys: set AWS_ACCESS_KEY_ID and "
                                    "AWS_SECRET_ACCESS_KEY: ") +
                            name + " is not set");
    }
    access.session_token = value_of(variable, {"AWS_SESSION_TOKEN"});
    if (const std::string region = value_of(variable, {"AWS_REGION", "AWS_DEFAULT_REGION"});
        !region.empty())
        access.region = region;
    access.endpoint = value_of(variable, {"AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL"});
    while (access.endpoint.ends_with('/')) access.endpoint.pop_back();
    if (!access.endpoint.empty() && !access.endpoint.starts_with("http://") &&
        !access.endpoint.starts_with("https://"))
        throw Error(ErrorCode::InvalidArgument,
                    "AWS_ENDPOINT_URL " + access.endpoint + ": expected https://HOST[:PORT]");
    return access;
}

std::string object_url(const BucketAddress& bucket, const BucketAccess& access,
                       std::string_view key) {
    const std::string path = "/" + encoded(key);
    if (!access.endpoint.empty()) return access.endpoint + "/" + bucket.name + path;
    const std::string host = "s3." + access.region + ".amazonaws.com";
    if (bucket.name.find('.') != std::string::npos)
        return "https://" + host + "/" + bucket.name + path;
    return "https://" + bucket.name + "." + host + path;
}

void require_bucket(const BucketAddress& bucket, const BucketAccess& access) {
    const std::string key = bucket.prefix + "manifest.json";
    Request request(access, object_url(bucket, access, key), proto::sha256_hex({}));
    request.set(CURLOPT_RANGE, "0-0");
    const CURLcode code = curl().easy_perform(request.easy());
    const std::string reason = request.reason();
    // Who may only write is told nothing of what is there.
    if (request.succeeded(code) || reason == "NoSuchKey" || reason == "AccessDenied") return;
    throw request.error(code, "s3://" + bucket.name);
}

void put_objects(const BucketAddress& bucket, const BucketAccess& access,
                 std::span<const BucketObject> objects,
                 const std::function<void(std::uint64_t)>& on_bytes, const std::stop_token& stop) {
    std::deque<Waiting> waiting;
    for (const BucketObject& object : objects) waiting.push_back({&object});
    Transfers transfers;
    std::uint64_t done = 0;
    while (!waiting.empty() || transfers.size() > 0) {
        if (stop.stop_requested()) throw Cancelled();
        const Clock::time_point now = Clock::now();
        while (transfers.size() < kAtOnce) {
            const auto next = std::ranges::find_if(
                waiting, [now](const Waiting& w) { return w.not_before <= now; });
            if (next == waiting.end()) break;
            transfers.begin(std::make_unique<Transfer>(bucket, access, *next->object, next->tries));
            waiting.erase(next);
        }
        transfers.go_on([&](const Transfer& ended, CURLcode code) {
            if (ended.request.succeeded(code)) {
                done += fs::file_size(ended.object.file);
                return;
            }
            if (!ended.request.may_pass(code) || ended.tries == kMostTries)
                throw ended.request.error(code, ended.object.key);
            const std::chrono::milliseconds pause(250 << ended.tries);
            waiting.push_back({&ended.object, ended.tries, Clock::now() + pause});
        });
        on_bytes(done + transfers.bytes_sent());
    }
}

}  // namespace stipple::cli
