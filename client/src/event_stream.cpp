#include "event_stream.hpp"

#include <utility>

namespace stipple {

void EventStreamParser::feed(std::string_view bytes) {
    for (const char c : bytes) {
        // A line ends with LF, CR or CRLF; the LF of a CRLF may come with the next piece.
        const bool rest_of_line_end = c == '\n' && after_carriage_return_;
        after_carriage_return_ = c == '\r';
        if (rest_of_line_end) continue;
        if (c == '\n' || c == '\r')
            end_line();
        else
            line_ += c;
    }
}

void EventStreamParser::end_line() {
    std::string_view line = line_;
    if (std::exchange(first_line_, false) && line.starts_with("\xEF\xBB\xBF"))
        line.remove_prefix(3);
    const std::size_t colon = line.find(':');
    if (line.empty()) {
        dispatch();
    } else if (colon != 0) {  // a line that begins with a colon is a comment: a heartbeat
        std::string_view value = colon == line.npos ? "" : line.substr(colon + 1);
        if (value.starts_with(' ')) value.remove_prefix(1);
        field(line.substr(0, colon), value);
    }
    line_.clear();
}

void EventStreamParser::field(std::string_view name, std::string_view value) {
    if (name == "event") event_.type = value;
    if (name == "id" && value.find('\0') == value.npos) event_.id = value;
    if (name == "data") {
        if (std::exchange(has_data_, true)) event_.data += '\n';
        event_.data += value;
    }
}

void EventStreamParser::dispatch() {
    if (has_data_) {
        if (event_.type.empty()) event_.type = "message";
        on_event_(event_);
    }
    event_.type.clear();
    event_.data.clear();
    has_data_ = false;
}

}  // namespace stipple
