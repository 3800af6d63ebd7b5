#pragma once

#include "stipple/splat_renderer.hpp"

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

namespace stipple {

/// The meaning of the colours of a picture: viridis from `low` to `high`.
struct Legend {
    std::string title;  ///< with the unit
    double low = 0, high = 1;
};

enum class Align { Left, Center, Right };

/// A white sheet for pictures, captions and legends, drawn without a display; lengths are in pixels
/// from the top left. Text is set in DejaVu Sans, or in another font of the system if that is
/// missing.
class Sheet {
public:
    /// @throws Error(InvalidArgument) for a side outside of 1..32767, Error(TooLarge) if there is
    /// not enough memory.
    Sheet(unsigned width, unsigned height);
    ~Sheet();
    Sheet(const Sheet&) = delete;
    Sheet& operator=(const Sheet&) = delete;

    void put(const Image& image, double x, double y);
    /// UTF-8; truncated at `width` if that is above 0.
    void text(const std::string& text, double x, double baseline, double size, Align align,
              bool bold = false, double width = 0);
    /// A bar of `width` with its ends and quarters labelled, and its title below: 50 pixels high in
    /// all.
    void legend(const Legend& legend, double x, double y, double width);

    /// The sheet so far.
    Image image() const;
    /// The sheet as a PNG file.
    std::vector<std::byte> png() const;

private:
    struct Surface;
    std::unique_ptr<Surface> surface_;
};

}  // namespace stipple
