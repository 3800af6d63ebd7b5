#pragma once

#include "stipple/error.hpp"

#include <string>

namespace stipple {

/// The server needs an API key, or does not know the one given.
class Unauthorized : public Error {
public:
    explicit Unauthorized(const std::string& message)
        : Error(ErrorCode::InvalidArgument, message) {}
};

/// No answer came, or only a part of one: the server or the way to it is down. The one failure that
/// trying again later may mend.
class Unreachable : public Error {
public:
    explicit Unreachable(const std::string& message) : Error(ErrorCode::Internal, message) {}
};

}  // namespace stipple
