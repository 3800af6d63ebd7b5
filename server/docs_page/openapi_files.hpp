#pragma once

#include <string_view>

namespace stipple::server::openapi {

/// A text built into the program from openapi.yaml.
struct File {
    std::string_view text, media_type, etag;
};

File document();  ///< openapi.yaml as it is
File page();      ///< the same for reading: `/docs`
File style();     ///< the style sheet of that page

}  // namespace stipple::server::openapi
