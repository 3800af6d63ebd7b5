#include "base/parallel_for.hpp"
#include "codec/ply_body.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <array>
#include <exception>
#include <numeric>
#include <string_view>

// One vertex a line is read in blocks of lines, in parallel; text that is not, value after value.

namespace stipple {

namespace {

/// Whether the first vertex has a line to itself, as in all but hand-made files. Then every one
/// must; else the text must have as many values as the header declares.
bool starts_with_one_per_line(AsciiCursor cursor, std::size_t values) {
    cursor.skip_blanks();
    for (std::size_t i = 0; i < values; ++i) {
        if (cursor.at_end_of_line()) return false;
        cursor.seek(
            cursor.position() +
            ply_number::word_at(cursor.position(), cursor.position() + cursor.remaining()).size());
    }
    return cursor.at_end_of_line();
}

constexpr std::size_t kTextPerBlock = std::size_t{1} << 18;

/// Lines of text cut into blocks of bytes: a line belongs to the block that holds the newline
/// before it.
struct TextBlocks {
    std::string_view text;
    std::vector<std::size_t> newlines_before;  ///< of each block; at the end, of all

    std::size_t size() const noexcept { return newlines_before.size() - 1; }
    std::size_t newlines() const noexcept { return newlines_before.back(); }
    std::string_view block(std::size_t b) const {
        return text.substr(b * kTextPerBlock, kTextPerBlock);
    }
};

/// `std::count` of newlines, eight bytes at a time.
std::size_t count_newlines(const char* p, const char* end) {
    constexpr std::uint64_t kOnes = 0x0101010101010101;
    constexpr std::uint64_t kLow = 0x7f * kOnes;
    std::size_t newlines = 0;
    for (; end - p >= 8; p += 8) {
        std::uint64_t bytes;
        std::memcpy(&bytes, p, 8);
        bytes ^= '\n' * kOnes;
        // The high bit of each byte that is zero now.
        newlines +=
            static_cast<std::size_t>(std::popcount(~(((bytes & kLow) + kLow) | bytes | kLow)));
    }
    return newlines + static_cast<std::size_t>(std::count(p, end, '\n'));
}

TextBlocks cut_into_blocks(std::string_view text, const RunContext& context) {
    TextBlocks blocks{
        text, std::vector<std::size_t>((text.size() + kTextPerBlock - 1) / kTextPerBlock + 1)};
    parallel_for_blocks(text.size(), kTextPerBlock, context,
                        [&](std::size_t begin, std::size_t end) {
                            blocks.newlines_before[begin / kTextPerBlock + 1] =
                                count_newlines(text.data() + begin, text.data() + end);
                        });
    std::partial_sum(blocks.newlines_before.begin(), blocks.newlines_before.end(),
                     blocks.newlines_before.begin());
    return blocks;
}

/// Reads line after line until `rows` are there, passing blank lines.
void read_lines(AsciiCursor& cursor, const RowReader<AsciiCursor>& read_row, std::size_t rows,
                const RunContext& context) {
    cursor.within_line = true;
    for (std::size_t row = 0; row < rows; ++row) {
        if (row % kRowsBetweenCheckpoints == 0) {
            context.checkpoint(static_cast<double>(row) / static_cast<double>(rows));
        }
        cursor.skip_blanks();
        read_row(cursor, row);
        cursor.expect_end_of_line();
    }
    cursor.within_line = false;
}

enum class BlockOutcome { Read, HasBlankLine };

/// Reads the vertices on the lines of one block.
BlockOutcome read_block(AsciiCursor cursor, const TextBlocks& blocks, std::size_t b,
                        const RowReader<AsciiCursor>& read_row, std::size_t rows) {
    cursor.within_line = true;
    const char* line = b == 0 ? blocks.text.data() : nullptr;
    std::size_t row = b == 0 ? 0 : blocks.newlines_before[b] + 1;
    const std::size_t end = std::min(rows, blocks.newlines_before[b + 1] + 1);
    if (row >= end) return BlockOutcome::Read;
    if (line == nullptr) line = blocks.block(b).data() + blocks.block(b).find('\n') + 1;
    for (cursor.seek(line); row < end; ++row) {
        if (cursor.at_end_of_line()) return BlockOutcome::HasBlankLine;
        read_row(cursor, row);
        cursor.expect_end_of_line();
        if (cursor.remaining() != 0) cursor.seek(cursor.position() + 1);
    }
    return BlockOutcome::Read;
}

/// Reads one vertex a line, in parallel. False when the lines are not where they were expected:
/// then nothing is known.
bool read_lines_in_blocks(const AsciiCursor& cursor, const TextBlocks& blocks,
                          const RowReader<AsciiCursor>& read_row, std::size_t rows,
                          const RunContext& context) {
    if (blocks.newlines() + 1 < rows) return false;
    const auto last = std::ranges::lower_bound(blocks.newlines_before, rows);
    const auto used = std::min(static_cast<std::size_t>(last - blocks.newlines_before.begin()) + 1,
                               blocks.size());
    constexpr std::size_t kBlocksPerReport = 64;
    for (std::size_t first = 0; first < used; first += kBlocksPerReport) {
        context.checkpoint(static_cast<double>(first) / static_cast<double>(used));
        const std::size_t count = std::min(kBlocksPerReport, used - first);
        std::array<BlockOutcome, kBlocksPerReport> outcomes{};
        std::array<std::exception_ptr, kBlocksPerReport> faults;
        parallel_for_blocks(count, 1, context, [&](std::size_t b, std::size_t) {
            try {
                outcomes[b] = read_block(cursor, blocks, first + b, read_row, rows);
            } catch (const Error&) {
                faults[b] = std::current_exception();
            }
        });
        // The first in the file, whichever thread found one first: nothing after it is read.
        for (std::size_t b = 0; b < count; ++b) {
            if (outcomes[b] == BlockOutcome::HasBlankLine) return false;
            if (faults[b]) std::rethrow_exception(faults[b]);
        }
    }
    return true;
}

const char* end_of_lines(const TextBlocks& blocks, std::size_t lines) {
    const char* const end = blocks.text.data() + blocks.text.size();
    if (lines == 0) return blocks.text.data();
    if (blocks.newlines() < lines) return end;
    const auto after = std::ranges::lower_bound(blocks.newlines_before, lines);
    const auto b = static_cast<std::size_t>(after - blocks.newlines_before.begin()) - 1;
    const char* position = blocks.block(b).data();
    for (std::size_t left = lines - blocks.newlines_before[b]; left != 0; --left) {
        position = std::find(position, end, '\n') + 1;
    }
    return position;
}

/// Of those that are not blank.
std::size_t count_lines(std::string_view text) {
    std::size_t lines = 0;
    while (!text.empty()) {
        const std::string_view line = text.substr(0, text.find('\n'));
        if (!std::ranges::all_of(line, ply_number::is_blank)) ++lines;
        text.remove_prefix(std::min(text.size(), line.size() + 1));
    }
    return lines;
}

/// Whether the elements are all that is left of the text.
bool end_the_text(AsciiCursor cursor, std::span<const PlyElement> elements,
                  const RunContext& context) {
    try {
        for (const PlyElement& element : elements) skip_element(cursor, element, context);
    } catch (const Error&) {
        return false;
    }
    cursor.skip_blanks();
    return cursor.remaining() == 0;
}

/// What follows the vertices is not kept, but it must be there. Counting lines settles that for
/// nearly every file.
/// @return  how many lines there are beyond all that the header declares.
std::size_t check_following(AsciiCursor cursor, std::span<const PlyElement> following,
                            const TextBlocks& blocks, std::size_t rows, const RunContext& context) {
    cursor.seek(end_of_lines(blocks, rows));
    const std::string_view rest(cursor.position(), cursor.remaining());
    if (following.empty()) return count_lines(rest);
    double expected = 0;
    for (const PlyElement& element : following) {
        if (!element.properties.empty()) expected += static_cast<double>(element.count);
    }
    const std::size_t all = blocks.newlines() + (blocks.text.ends_with('\n') ? 0 : 1);
    const double left = static_cast<double>(all) - static_cast<double>(rows);
    if (left == expected) return 0;
    if (left < expected) {
        for (const PlyElement& element : following) skip_element(cursor, element, context);
        return 0;
    }
    const std::size_t lines = count_lines(rest);
    if (static_cast<double>(lines) <= expected || end_the_text(cursor, following, context))
        return 0;
    return lines - static_cast<std::size_t>(expected);
}

/// Names lines beyond all that the header declares.
void report_surplus(std::size_t lines, bool after_vertices, DecodeReport& report) {
    if (lines == 0) return;
    report.skipped.push_back(std::to_string(lines) + (lines == 1 ? " line" : " lines") +
                             surplus_place(after_vertices));
}

}  // namespace

PointCloud decode_ascii_ply(const PlyLayout& layout, const RunContext& context,
                            DecodeReport& report) {
    AsciiCursor cursor(layout.file, layout.header.body);
    const auto& elements = layout.header.elements;
    const PlyElement* const vertex = layout.vertex;
    for (const PlyElement* element = elements.data(); element != vertex; ++element) {
        skip_element(cursor, *element, context);
    }
    const std::span<const PlyElement> following(vertex + 1, elements.data() + elements.size());

    cursor.place = {vertex, 0};
    cursor.require(*vertex);
    cursor.skip_blanks();
    const bool lists = vertex->has_list();
    if (lists || !starts_with_one_per_line(cursor, vertex->properties.size())) {
        PointCloud cloud = decode_values(cursor, layout, context, report);
        for (const PlyElement& element : following) skip_element(cursor, element, context);
        cursor.skip_blanks();
        if (!lists && cursor.remaining() != 0)
            cursor.fail(nullptr,
                        "the text goes on with " +
                            in_quotes(ply_number::word_at(cursor.position(),
                                                          cursor.position() + cursor.remaining())) +
                            " after all that the header declares: lines may have more values "
                            "than the " +
                            std::to_string(vertex->properties.size()) + " properties of a vertex");
        report_surplus(count_lines({cursor.position(), cursor.remaining()}), following.empty(),
                       report);
        return cloud;
    }

    PlyDestination destination(layout, std::nullopt);
    const RowReader<AsciiCursor> read_row(destination.columns);
    const TextBlocks blocks = cut_into_blocks({cursor.position(), cursor.remaining()}, context);
    const std::size_t rows = destination.rows();
    std::size_t surplus = 0;
    if (!read_lines_in_blocks(cursor, blocks, read_row, rows, context)) {
        read_lines(cursor, read_row, rows, context);
        for (const PlyElement& element : following) skip_element(cursor, element, context);
        surplus = count_lines({cursor.position(), cursor.remaining()});
    } else {
        surplus = check_following(cursor, following, blocks, rows, context);
    }
    report_surplus(surplus, following.empty(), report);
    return destination.finish(report);
}

}  // namespace stipple
