#pragma once

#include <functional>
#include <string>
#include <string_view>

namespace stipple {

/// Reads `text/event-stream` (WHATWG HTML, 9.2.6) from pieces of any size.
class EventStreamParser {
public:
    struct Event {
        std::string id;    ///< of this event or the last before it that had one
        std::string type;  ///< `message` when the stream does not say
        std::string data;  ///< lines joined by line feeds
    };

    explicit EventStreamParser(std::function<void(const Event&)> on_event)
        : on_event_(std::move(on_event)) {}

    void feed(std::string_view bytes);

private:
    void end_line();
    void field(std::string_view name, std::string_view value);
    void dispatch();

    std::function<void(const Event&)> on_event_;
    std::string line_;
    bool after_carriage_return_ = false;
    bool first_line_ = true;
    bool has_data_ = false;
    Event event_;
};

}  // namespace stipple
