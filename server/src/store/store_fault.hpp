#pragma once

#include "stipple/error.hpp"

#include <string>

namespace stipple::server {

/// What a store lies on refuses for now, as where a disk is away or may not be read, or another
/// program holds the database: nothing was written, and the same call may do it a while later.
class StoreFault : public Error {
public:
    explicit StoreFault(const std::string& message) : Error(ErrorCode::Internal, message) {}
};

}  // namespace stipple::server
