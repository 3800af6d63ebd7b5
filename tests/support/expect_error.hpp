#pragma once

#include "stipple/error.hpp"

#include <gtest/gtest.h>
#include <string_view>

namespace stipple::test {

/// Expects an Error of this kind whose message holds `part`.
template <typename Call>
void expect_error(ErrorCode code, std::string_view part, Call call) {
    try {
        call();
        ADD_FAILURE() << "nothing was thrown; expected " << to_string(code) << ": " << part;
    } catch (const Error& error) {
        EXPECT_EQ(to_string(error.code()), to_string(code)) << error.what();
        EXPECT_NE(std::string_view(error.what()).find(part), std::string_view::npos)
            << error.what() << "\ndoes not hold: " << part;
    }
}

/// Most refusals are of this kind.
template <typename Call>
void expect_refused(std::string_view part, Call call) {
    expect_error(ErrorCode::InvalidArgument, part, call);
}

}  // namespace stipple::test
