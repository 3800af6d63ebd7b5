#include "stipple/error.hpp"

namespace stipple {

std::string_view to_string(ErrorCode code) noexcept {
    switch (code) {
        case ErrorCode::InvalidArgument:
            return "invalid-argument";
        case ErrorCode::MalformedInput:
            return "malformed-input";
        case ErrorCode::UnsupportedFormat:
            return "unsupported-format";
        case ErrorCode::TooLarge:
            return "too-large";
        case ErrorCode::NotFound:
            return "not-found";
        case ErrorCode::Conflict:
            return "conflict";
        case ErrorCode::QueueFull:
            return "queue-full";
        case ErrorCode::Internal:
            break;
    }
    return "internal";
}

}  // namespace stipple
