// The library without the page: what is built where npm is missing or STIPPLE_BUILD_VIEWER is off.
#include "viewer_files.hpp"

namespace stipple::viewer {

std::span<const File> files() {
    return {};
}

}  // namespace stipple::viewer
