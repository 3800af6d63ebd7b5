#include "codec/ply_header.hpp"

#include "base/in_quotes.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <utility>

namespace stipple {

namespace {

constexpr std::size_t kLongestHeader = std::size_t{1} << 20;
constexpr std::size_t kMostProperties = 4096, kMostElements = 4096;

/// The first name of each type is what is written.
constexpr std::array<std::pair<std::string_view, PlyType>, 19> kTypeNames = {{
    {"char", PlyType::Int8},     {"uchar", PlyType::UInt8},     {"short", PlyType::Int16},
    {"ushort", PlyType::UInt16}, {"int", PlyType::Int32},       {"uint", PlyType::UInt32},
    {"float", PlyType::Float32}, {"double", PlyType::Float64},  {"int64", PlyType::Int64},
    {"uint64", PlyType::UInt64}, {"int8", PlyType::Int8},       {"uint8", PlyType::UInt8},
    {"int16", PlyType::Int16},   {"uint16", PlyType::UInt16},   {"int32", PlyType::Int32},
    {"uint32", PlyType::UInt32}, {"float32", PlyType::Float32}, {"float64", PlyType::Float64},
    {"bool", PlyType::UInt8},  // not in the format, but written by tools over NumPy: one byte
}};

class HeaderParser {
public:
    explicit HeaderParser(std::string_view file) : file_(file) {
        const std::size_t end = file.find_first_of("\r\n");
        // Old Macintosh files end their lines in CR alone.
        const bool cr_alone = end != file.npos && file[end] == '\r' &&
                              (end + 1 == file.size() || file[end + 1] != '\n');
        line_end_ = cr_alone ? '\r' : '\n';
    }

    PlyHeader parse() {
        next_line();
        if (words_.size() != 1 || words_[0] != "ply")
            fail("expected 'ply' alone, got " + in_quotes(line_));
        while (next_line(), words_.empty() || words_[0] != "end_header") take_line();
        if (!format_known_) fail("end_header before any format line");
        header_.body = position_;
        return std::move(header_);
    }

private:
    void next_line() {
        const std::size_t end = file_.substr(0, kLongestHeader).find(line_end_, position_);
        ++line_number_;
        if (end == file_.npos) {
            const bool too_long = file_.size() > kLongestHeader;
            // `end_header` may be the last thing in the file when there is nothing to follow.
            line_ = file_.substr(std::min(position_, file_.size()));
            position_ = file_.size();
            if (!too_long && line_ == "end_header") return split();
            fail(too_long ? "no end_header within " + std::to_string(kLongestHeader) + " bytes"
                          : "the file ends inside the header, without end_header");
        }
        line_ = file_.substr(position_, end - position_);
        position_ = end + 1;
        split();
    }

    void split() {
        constexpr std::string_view kBlanks = " \t\r\v\f";
        words_.clear();
        std::size_t from = line_.find_first_not_of(kBlanks);
        while (from != line_.npos) {
            const std::size_t to = std::min(line_.find_first_of(kBlanks, from), line_.size());
            words_.push_back(line_.substr(from, to - from));
            from = line_.find_first_not_of(kBlanks, to);
        }
    }

    void take_line() {
        if (words_.empty()) return;
        const std::string_view keyword = words_[0];
        if (keyword == "comment" || keyword == "obj_info") return take_comment();
        if (keyword == "format") return take_format();
        if (keyword == "element") return take_element();
        if (keyword == "property") return take_property();
        if (!header_.elements.empty()) {
            fail("unknown keyword " + in_quotes(keyword) +
                 ": expected element, property, comment, obj_info or end_header");
        }
        header_.unknown_lines.push_back("header line " + std::to_string(line_number_) + ": " +
                                        in_quotes(line_));
    }

    void take_comment() {
        const auto from =
            static_cast<std::size_t>(words_[0].data() - line_.data()) + words_[0].size();
        std::string_view text = line_.substr(from);
        const std::size_t first = text.find_first_not_of(" \t\r");
        text = first == text.npos ? ""
                                  : text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
        header_.comments.emplace_back(text);
        std::ranges::replace(header_.comments.back(), '\r', ' ');  // in a comment, no end of a line
    }

    void take_format() {
        if (format_known_) fail("a second format line");
        if (words_.size() != 3) fail("expected 'format ENCODING 1.0', got " + in_quotes(line_));
        constexpr std::array kEncodings = {PlyEncoding::Ascii, PlyEncoding::BinaryLittleEndian,
                                           PlyEncoding::BinaryBigEndian};
        const auto known =
            std::ranges::find(kEncodings, words_[1], [](PlyEncoding e) { return name_of(e); });
        if (known == kEncodings.end()) {
            fail("format " + in_quotes(words_[1]) +
                     ": expected ascii, binary_little_endian or binary_big_endian",
                 ErrorCode::UnsupportedFormat);
        }
        if (words_[2] != "1.0") {
            fail("format version " + in_quotes(words_[2]) + ": expected 1.0",
                 ErrorCode::UnsupportedFormat);
        }
        header_.encoding = *known;
        format_known_ = true;
    }

    void take_element() {
        if (words_.size() != 3) fail("expected 'element NAME COUNT', got " + in_quotes(line_));
        PlyElement element{std::string(words_[1]), 0, {}};
        const std::string_view count = words_[2];
        const auto [end, error] =
            std::from_chars(count.data(), count.data() + count.size(), element.count);
        if (error != std::errc() || end != count.data() + count.size()) {
            fail("element " + in_quotes(element.name) + " has the count " + in_quotes(count) +
                 ": expected 0..2^64-1");
        }
        if (std::ranges::find(header_.elements, element.name, &PlyElement::name) !=
            header_.elements.end()) {
            fail("a second element " + in_quotes(element.name));
        }
        if (header_.elements.size() == kMostElements)
            fail("more than " + std::to_string(kMostElements) + " elements");
        header_.elements.push_back(std::move(element));
    }

    void take_property() {
        if (header_.elements.empty()) fail("a property before any element");
        const bool list = words_.size() == 5 && words_[1] == "list";
        if (!list && words_.size() != 3) {
            fail("expected 'property TYPE NAME' or 'property list COUNT_TYPE TYPE NAME', got " +
                 in_quotes(line_));
        }
        PlyProperty property{std::string(words_.back()), type_named(words_[words_.size() - 2]), {}};
        if (list) {
            property.count_type = type_named(words_[2]);
            if (*property.count_type == PlyType::Float32 ||
                *property.count_type == PlyType::Float64) {
                fail("list " + in_quotes(property.name) + " has a length of type " +
                     in_quotes(words_[2]) + ": expected an integer type");
            }
        }
        PlyElement& element = header_.elements.back();
        if (std::ranges::find(element.properties, property.name, &PlyProperty::name) !=
            element.properties.end()) {
            fail("a second property " + in_quotes(property.name) + " of element " +
                 in_quotes(element.name));
        }
        if (element.properties.size() == kMostProperties) {
            fail("more than " + std::to_string(kMostProperties) + " properties of element " +
                     in_quotes(element.name),
                 ErrorCode::TooLarge);
        }
        element.properties.push_back(std::move(property));
    }

    PlyType type_named(std::string_view name) const {
        const auto found =
            std::ranges::find(kTypeNames, name, &std::pair<std::string_view, PlyType>::first);
        if (found == kTypeNames.end()) {
            fail("type " + in_quotes(name) +
                 ": expected char, uchar, short, ushort, int, uint, float, double, or "
                 "int8 to float64");
        }
        return found->second;
    }

    [[noreturn]] void fail(const std::string& what,
                           ErrorCode code = ErrorCode::MalformedInput) const {
        throw Error(code, "PLY header, line " + std::to_string(line_number_) + ": " + what);
    }

    std::string_view file_;
    char line_end_;
    std::size_t position_ = 0;
    std::size_t line_number_ = 0;
    std::string_view line_;
    std::vector<std::string_view> words_;
    bool format_known_ = false;
    PlyHeader header_;
};

}  // namespace

std::size_t size_of(PlyType type) noexcept {
    return with_type(type, []<typename T>() { return sizeof(T); });
}

std::string_view name_of(PlyType type) noexcept {
    return kTypeNames[static_cast<std::size_t>(type)].first;
}

std::string_view name_of(PlyEncoding encoding) noexcept {
    switch (encoding) {
        case PlyEncoding::BinaryLittleEndian:
            return "binary_little_endian";
        case PlyEncoding::BinaryBigEndian:
            return "binary_big_endian";
        case PlyEncoding::Ascii:
            break;
    }
    return "ascii";
}

bool PlyElement::has_list() const noexcept {
    return std::ranges::any_of(properties, &PlyProperty::is_list);
}

std::uint64_t PlyElement::least_bytes() const noexcept {
    std::uint64_t bytes = 0;
    for (const PlyProperty& property : properties)
        bytes += size_of(property.count_type.value_or(property.type));
    return bytes;
}

std::uint64_t earliest_end(const PlyElement& element, PlyEncoding encoding, std::uint64_t at,
                           std::uint64_t file_bytes) {
    const bool ascii = encoding == PlyEncoding::Ascii;
    // A value of a text takes a digit and, but for the last of the file, a blank.
    const std::uint64_t bytes = ascii ? 2 * element.properties.size() : element.least_bytes();
    const std::uint64_t remaining = file_bytes - at;
    if (bytes != 0 && element.count > (remaining + (ascii ? 1 : 0)) / bytes) {
        throw Error(ErrorCode::MalformedInput,
                    "PLY: the header declares " + std::to_string(element.count) + " of element " +
                        in_quotes(element.name) +
                        (ascii || element.has_list() ? ", at least " : ", ") +
                        std::to_string(bytes) + (ascii ? " characters" : " bytes") +
                        " each, but only " + std::to_string(remaining) + " bytes follow byte " +
                        std::to_string(at) + ": the file is cut short or the count is wrong");
    }
    return std::min(at + element.count * bytes, file_bytes);
}

PlyHeader parse_ply_header(std::span<const std::byte> file) {
    return HeaderParser({reinterpret_cast<const char*>(file.data()), file.size()}).parse();
}

bool holds_ply_header(std::span<const std::byte> head) noexcept {
    constexpr std::string_view kLastWord = "end_header", kLineEnds = "\r\n";
    const std::string_view text(reinterpret_cast<const char*>(head.data()), head.size());
    std::size_t at = 0;
    while ((at = text.find(kLastWord, at + 1)) != text.npos) {
        if (kLineEnds.find(text[at - 1]) != kLineEnds.npos)
            return text.find_first_of(kLineEnds, at) != text.npos;
    }
    return false;
}

}  // namespace stipple
