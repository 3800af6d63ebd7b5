// The one source that includes cpp-httplib. Of the library it takes what is laborious and harmless:
// the parsing of a target with its query, and the writing of replies. The bytes of a request reach
// it only after `parse_head` found them clean, as a head without any field that the library would
// act on (ranges, codings, bodies): versions from 0.11.4 on differ, and err, there.

#include "http/connection.hpp"

#include "http/framed_body.hpp"
#include "http/request_head.hpp"

#include <httplib.h>
#include <algorithm>
#include <array>
#include <cstring>
#include <type_traits>

namespace stipple::server::http {

namespace {

constexpr int kMaxRequestsPerConnection = 1000;
constexpr std::size_t kPieceBytes = 256 * 1024;
constexpr std::size_t kGatheredBytes = 64 * 1024;

/// What the library is let to see of a connection: a clean head to read, and the client to write
/// to.
class GuardedStream final : public httplib::Stream {
public:
    GuardedStream(std::string head, ClientSocket& socket)
        : head_(std::move(head)), socket_(socket) {}

    bool is_readable() const override { return read_ < head_.size(); }
    bool is_writable() const override { return !broken_; }
    ssize_t read(char* out, std::size_t size) override {
        const std::size_t n = std::min(size, head_.size() - read_);
        std::memcpy(out, head_.data() + read_, n);
        read_ += n;
        return static_cast<ssize_t>(n);
    }
    ssize_t write(const char* bytes, std::size_t size) override {
        if (gathered_.size() + size > kGatheredBytes) flush();
        if (gathers_ && size <= kGatheredBytes) {
            gathered_.append(bytes, size);
        } else {
            send({bytes, size});
        }
        if (broken_) return -1;
        written_ += size;
        return static_cast<ssize_t>(size);
    }
    void get_remote_ip_and_port(std::string& ip, int& port) const override {
        ip = socket_.address();
        port = 0;
    }
    void get_local_ip_and_port(std::string& ip, int& port) const override {
        ip.clear();
        port = 0;
    }
    // The library compares it with FD_SETSIZE before its own select; all waiting is done by
    // ClientSocket.
    socket_t socket() const override { return INVALID_SOCKET; }

    // Later versions have these, too.
    bool wait_readable() const { return is_readable(); }
    bool wait_writable() const { return is_writable(); }
    time_t duration() const { return 0; }

    /// The reply ends with its head, whatever its length: the library would say 0, which is not
    /// that of the content that a 304 stands for (RFC 9110, 8.6).
    void leave_out_length() noexcept { tells_length_ = false; }
    /// A stream is sent piece by piece as it comes.
    void gather(bool whole_reply) noexcept { gathers_ = whole_reply; }
    /// Sends what was gathered: of a small reply head and content at once, in one packet.
    void flush() {
        if (!tells_length_) {
            constexpr std::string_view kField = "Content-Length: 0\r\n";
            const auto at = gathered_.find(kField);
            if (at < gathered_.find("\r\n\r\n")) {
                gathered_.erase(at, kField.size());
                written_ -= kField.size();
            }
            tells_length_ = true;
        }
        send(gathered_);
        gathered_.clear();
    }

    /// The client has gone: nothing more is written.
    void give_up() noexcept { broken_ = true; }

    std::uint64_t written() const noexcept { return written_; }
    bool broken() const noexcept { return broken_; }

private:
    void send(std::string_view bytes) {
        if (broken_ || bytes.empty()) return;
        try {
            socket_.write_all(bytes);
        } catch (const Disconnected&) {
            broken_ = true;
        }
    }

    const std::string head_;
    std::size_t read_ = 0;
    ClientSocket& socket_;
    std::string gathered_;
    bool gathers_ = true, tells_length_ = true;
    std::uint64_t written_ = 0;
    bool broken_ = false;
};

/// Hands the reply's content to the library in the form that it writes.
struct ContentSetter {
    httplib::Response& response;
    const std::string& media_type;
    bool takes_chunks;  ///< else a stream ends with its connection

    void operator()(std::string& text) const {
        if (!text.empty()) response.set_content(text, media_type);
    }
    void operator()(FixedBytes bytes) const {
        provide(bytes.size(),
                [bytes](std::size_t offset, std::size_t length, httplib::DataSink& sink) {
                    return sink.write(reinterpret_cast<const char*>(bytes.data()) + offset, length);
                });
    }
    void operator()(const StoredRange& range) const {
        if (const auto* const bytes = std::get_if<0>(&range.content)) {
            provide(static_cast<std::size_t>(range.length),
                    [bytes = *bytes, from = range.offset](std::size_t offset, std::size_t length,
                                                          httplib::DataSink& sink) {
                        return sink.write(
                            reinterpret_cast<const char*>(bytes->data()) + from + offset, length);
                    });
            return;
        }
        auto buffer = std::make_shared<std::vector<std::byte>>(
            static_cast<std::size_t>(std::min<std::uint64_t>(kPieceBytes, range.length)));
        provide(static_cast<std::size_t>(range.length),
                [blob = std::get<1>(range.content), from = range.offset, buffer](
                    std::size_t offset, std::size_t length, httplib::DataSink& sink) {
                    const auto out = std::span(*buffer).first(std::min(length, buffer->size()));
                    const std::size_t n = blob->read(from + offset, out);
                    if (n == 0) throw Error(ErrorCode::Internal, "a stored file ends too early");
                    return sink.write(reinterpret_cast<const char*>(out.data()), n);
                });
    }
    void operator()(const Stream& stream) const {
        const auto provide_all = [stream](std::size_t, httplib::DataSink& sink) {
            write_all(stream, sink);
            sink.done();
            return true;
        };
        if (takes_chunks) {
            response.set_chunked_content_provider(media_type, provide_all);
        } else {
            response.set_content_provider(media_type, provide_all);
        }
    }

    void operator()(const SizedStream& sized) const {
        provide(static_cast<std::size_t>(sized.length),
                [stream = sized.write](std::size_t, std::size_t, httplib::DataSink& sink) {
                    write_all(stream, sink);
                    return true;
                });
    }

private:
    static void write_all(const Stream& stream, httplib::DataSink& sink) {
        stream([&sink](std::string_view piece) {
            if (!sink.write(piece.data(), piece.size())) throw Disconnected();
        });
    }
    void provide(std::size_t length, httplib::ContentProvider provider) const {
        // The library has no content of no bytes.
        if (length > 0) {
            response.set_content_provider(length, media_type, std::move(provider));
        } else {
            response.set_header("Content-Type", media_type);
        }
    }
};

/// The library, for one connection. Nothing of it listens, waits or runs threads.
class Library : private httplib::Server {
public:
    /// @param answer  called with each parsed request.
    /// @param takes_chunks  whether the client knows chunked content.
    Library(std::function<Reply(const httplib::Request&)> answer, bool takes_chunks)
        : answer_(std::move(answer)), takes_chunks_(takes_chunks) {
        set_keep_alive_max_count(kMaxRequestsPerConnection);
        set_keep_alive_timeout(10);  // only told to the client, as Patience::keep_alive is
        svr_sock_ =
            0;  // what it takes for "not being stopped" while it writes; never used as a socket
        set_pre_routing_handler(
            [this](const httplib::Request& request, httplib::Response& response) {
                fill(response, answer_(request));
                return HandlerResponse::Handled;
            });
        // Only a head that the library refuses although we did not comes here without a body.
        set_error_handler(Handler([](const httplib::Request&, httplib::Response& response) {
            if (!response.body.empty()) return;
            const HttpError error(response.status, "the request cannot be understood");
            response.set_content(proto::to_json(error.problem), "application/problem+json");
        }));
    }

    /// @returns false when the client has gone, or there was a failure.
    bool process(GuardedStream& stream, bool close) {
        bool closed = false;
        // Content that breaks off: half a reply is ended by closing the connection.
        try {
            return run(*this, stream, close, closed);
        } catch (const Disconnected&) {
        } catch (const std::exception& error) {
            failure_ = error.what();
        }
        return false;
    }

    /// Of the server, which kept it from sending the whole reply.
    const std::string& failure() const noexcept { return failure_; }

private:
    /// The signature differs between versions.
    template <typename Self>
    static bool run(Self& self, GuardedStream& stream, bool close, bool& closed) {
        if constexpr (requires { self.process_request(stream, close, closed, nullptr); }) {
            return self.process_request(stream, close, closed, nullptr);
        } else {
            return self.process_request(stream, std::string(), 0, std::string(), 0, close, closed,
                                        nullptr);
        }
    }

    void fill(httplib::Response& response, Reply reply) const {
        response.status = reply.status;
        for (const auto& [name, value] : reply.headers) response.set_header(name, value);
        // Of a HEAD alone the library would say that it takes ranges.
        if (!reply.headers.find("Accept-Ranges")) response.set_header("Accept-Ranges", "none");
        std::visit(ContentSetter{response, reply.media_type, takes_chunks_}, reply.content);
    }

    std::function<Reply(const httplib::Request&)> answer_;
    const bool takes_chunks_;
    std::string failure_;
};

/// What of a head the library needs to see.
std::string head_for_library(const RequestHead& head, bool close) {
    return head.method + " " + head.target + " HTTP/1.1\r\nHost: stipple\r\nContent-Length: 0\r\n" +
           (close ? "Connection: close\r\n" : "") + "\r\n";
}

/// One request and its reply.
class Exchange {
public:
    Exchange(RequestHead head, ClientSocket& socket, Application& application, std::stop_token stop,
             bool close)
        : head_(std::move(head)),
          socket_(socket),
          application_(application),
          stream_(head_for_library(head_, close), socket),
          close_(close),
          body_(
              head_, [&socket](std::span<std::byte> out) { return socket.read_some(out); },
              head_.expects_continue
                  ? [&socket] { socket.write_all("HTTP/1.1 100 Continue\r\n\r\n"); }
                  : std::function<void()>()) {
        request_.headers = head_.headers;
        request_.body = &body_;
        request_.remote_address = socket.address();
        request_.version = head_.http_1_0 ? "HTTP/1.0" : "HTTP/1.1";
        request_.stop = std::move(stop);
        request_.client_gone = [&socket] { return socket.peer_gone(); };
    }

    /// @returns whether the connection can be used for another request.
    bool run() {
        const auto begin = std::chrono::steady_clock::now();
        Library library([this](const httplib::Request& parsed) { return answer(parsed); },
                        !head_.http_1_0);
        const bool processed = library.process(stream_, close_);
        stream_.flush();
        const bool sent = processed && !stream_.broken();
        permit_.reset();
        application_.served(request_, {.status = status_,
                                       .bytes = stream_.written(),
                                       .seconds = std::chrono::steady_clock::now() - begin,
                                       .complete = sent,
                                       .failure = library.failure()});
        if (!sent) {
            socket_.end_by_reset();  // half a reply that ends with its connection would look whole
            throw Disconnected();
        }
        return !close_ && body_.finished();
    }

    /// Of the body, if nobody read it all.
    std::uint64_t left() const noexcept { return body_.left(); }

private:
    Reply answer(const httplib::Request& parsed) {
        request_.method = parsed.method;
        request_.path = parsed.path;
        for (const auto& [name, value] : parsed.params) {
            if (!request_.query.emplace(name, value).second) request_.repeated_query = name;
        }
        request_.query_text =
            head_.target.substr(std::min(head_.target.find('?'), head_.target.size()));
        Reply reply;
        try {
            reply = application_.handle(request_);
        } catch (const Disconnected&) {
            stream_.give_up();  // the library would make a reply of the exception
            reply.status = kClientLeft;
        }
        if (reply.status == 204 || reply.status == 304) stream_.leave_out_length();
        stream_.gather(!std::holds_alternative<Stream>(reply.content));
        status_ = reply.status;
        application_.answered(request_, status_);
        permit_ = reply.permit;
        // What is left of a body that nobody read would be taken for the next request.
        if (!body_.finished()) reply.headers.set("Connection", "close");
        return reply;
    }

    const RequestHead head_;
    ClientSocket& socket_;
    Application& application_;
    GuardedStream stream_;
    const bool close_;
    FramedBody body_;
    Request request_;
    std::shared_ptr<void> permit_;
    int status_ = 0;
};

void refuse(ClientSocket& socket, Application& application, const HttpError& error,
            std::string_view head) {
    socket.write_all(refusal(application, error.problem, socket.address(), given_id(head)));
    socket.close_gently();
}

}  // namespace

std::string refusal(Application& application, const proto::Problem& problem,
                    std::string_view address, std::string_view id_given) {
    const std::string id = request_id(id_given);
    application.refused(id, address, problem.status, problem.detail);
    Reply reply = problem_reply(HttpError(problem));
    reply.headers.set("X-Request-Id", id);
    const auto& body = std::get<std::string>(reply.content);
    std::string message =
        "HTTP/1.1 " + std::to_string(problem.status) + " " + problem.title + "\r\n";
    for (const auto& [name, value] : reply.headers) message += name + ": " + value + "\r\n";
    return message + "Content-Type: " + reply.media_type +
           "\r\nContent-Length: " + std::to_string(body.size()) + "\r\nConnection: close\r\n\r\n" +
           body;
}

void serve_connection(ClientSocket& socket, Application& application, const StopEvent& drain,
                      std::stop_token stop) {
    std::optional<std::string> text;
    try {
        for (int served = 1; served <= kMaxRequestsPerConnection; ++served) {
            socket.begin_exchange();
            text.reset();
            text = socket.read_head();
            if (!text) return;
            RequestHead head = parse_head(*text);
            const bool close =
                head.wants_close || served == kMaxRequestsPerConnection || drain.raised();
            Exchange exchange(std::move(head), socket, application, stop, close);
            if (!exchange.run()) return socket.close_gently(exchange.left());
        }
        socket.close_gently();
    } catch (const HttpError& error) {
        try {
            refuse(socket, application, error, text.value_or(""));
        } catch (const Disconnected&) {
        }
    } catch (const Disconnected&) {
    }
}

}  // namespace stipple::server::http
