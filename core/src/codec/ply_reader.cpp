// Reads PLY. The layout of a vertex is turned into one column a property, each with the place its
// values go to, before any value is read.

#include "codec/ply.hpp"
#include "codec/ply_body.hpp"

namespace stipple {

PointCloud decode_ply(std::span<const std::byte> file, const DecodeLimits& limits,
                      const RunContext& context, DecodeReport& report) {
    const PlyLayout layout = ply_layout_of(file);
    check_against(limits, layout);
    describe(layout, report);
    return layout.header.encoding == PlyEncoding::Ascii
               ? decode_ascii_ply(layout, context, report)
               : decode_binary_ply(layout, context, report);
}

void check_ply_head(std::span<const std::byte> head, std::uint64_t file_bytes,
                    const DecodeLimits& limits) {
    if (head.size() < file_bytes && !holds_ply_header(head)) return;
    const PlyLayout layout = ply_layout_of(head);
    check_against(limits, layout);
    std::uint64_t at = layout.header.body;
    for (const PlyElement& element : layout.header.elements)
        at = earliest_end(element, layout.header.encoding, at, file_bytes);
}

}  // namespace stipple
