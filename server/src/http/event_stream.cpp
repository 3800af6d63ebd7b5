#include "http/event_stream.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace stipple::server::http {

namespace {

using namespace std::chrono_literals;
using std::chrono::steady_clock;

constexpr auto kHeartbeat = 10s;
constexpr auto kLookAtClient = 1s;  ///< how soon a client that left is noticed

}  // namespace

void write_event(const JobEvent& event, const StreamWriter& write) {
    constexpr std::size_t kPiece = 256 << 10;  // of a large one, since each is copied once more
    const std::string head =
        "id: " + std::to_string(event.id) + "\nevent: " + event.type + "\ndata: ";
    std::string_view text = event.text();
    if (text.size() <= kPiece) return write(head + std::string(text) + "\n\n");
    write(head);
    for (; !text.empty(); text.remove_prefix(std::min(kPiece, text.size())))
        write(text.substr(0, kPiece));
    write("\n\n");
}

bool is_last(const JobEvent& event) {
    if (event.type != "status") return false;
    const auto data = nlohmann::json::parse(event.data);
    return proto::is_final(proto::job_status_from_name(data.at("status").get<std::string>()));
}

Stream event_stream(Service& service, const Request& request, const std::string& job_id,
                    std::uint64_t after) {
    return [&service, tenant = request.tenant, job_id, after, stop = request.stop,
            client_gone = request.client_gone](const StreamWriter& write) {
        std::uint64_t last = after;
        write("retry: 1000\n\n");
        auto last_write = steady_clock::now();
        while (!stop.stop_requested()) {
            const auto events = service.events(tenant, job_id, last, kLookAtClient, stop);
            for (const JobEvent& event : events.items) {
                write_event(event, write);
                last = event.id;
                last_write = steady_clock::now();
                if (is_last(event)) return;
            }
            if (events.complete) return;  // a client that resumed behind the last event
            if (client_gone()) throw Disconnected();
            if (steady_clock::now() - last_write >= kHeartbeat) {
                write(": still here\n\n");
                last_write = steady_clock::now();
            }
        }
    };
}

}  // namespace stipple::server::http
