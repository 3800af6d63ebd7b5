#include "progressive/progressive_layout.hpp"

#include "base/byte_writer.hpp"
#include "base/in_words.hpp"
#include "cloud/attribute_name.hpp"
#include "stipple/error.hpp"

#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <string_view>

namespace stipple {

namespace {

constexpr std::string_view kMagic = "STPC";
constexpr std::uint8_t kVersion = 3;
constexpr std::size_t kPreamble = 12;
constexpr std::size_t kMostHeader = std::size_t{1} << 20U;
constexpr std::size_t kMostBatches = 64;
constexpr unsigned kTypes = std::variant_size_v<AttributeValues>, kFloat = 6;

[[noreturn]] void malformed(const std::string& what) {
    throw Error(ErrorCode::MalformedInput, "progressive stream: " + what);
}

class Reader {
public:
    explicit Reader(std::span<const std::byte> bytes) : bytes_(bytes) {}
    template <typename T>
    T get() {
        std::array<std::byte, sizeof(T)> raw;
        std::ranges::copy(take(sizeof(T)), raw.begin());
        return std::bit_cast<T>(raw);
    }
    double finite(const char* what) {
        const auto value = get<double>();
        if (!std::isfinite(value)) malformed(std::string(what) + " is not a finite number");
        return value;
    }
    Vec3d place(const char* what) {
        Vec3d v;
        for (int axis = 0; axis < 3; ++axis) v[axis] = finite(what);
        return v;
    }
    std::string text(std::size_t length) {
        const auto taken = take(length);
        return {reinterpret_cast<const char*>(taken.data()), taken.size()};
    }
    bool at_end() const noexcept { return bytes_.empty(); }

private:
    std::span<const std::byte> take(std::size_t count) {
        if (count > bytes_.size()) malformed("the header ends too early");
        const auto taken = bytes_.first(count);
        bytes_ = bytes_.subspan(count);
        return taken;
    }
    std::span<const std::byte> bytes_;
};

void require_range(const char* what, std::uint64_t value, std::uint64_t least, std::uint64_t most) {
    if (value >= least && value <= most) return;
    malformed(std::string(what) + " " + std::to_string(value) + ": expected " +
              std::to_string(least) + ".." + std::to_string(most));
}

/// Clouds more than 1e15 across are refused (`require_squares`). Their grid, of steps that may be
/// up to twice a precision, reaches up to four times as far.
/// @param code  whose fault it is: the caller's who encodes, or the stream's.
void require_reach(const ProgressiveLayout& layout, ErrorCode code) {
    constexpr double kMostAcross = 4e15, kFarthest = std::numeric_limits<float>::max();
    const double across = std::ldexp(layout.step, layout.grid_bits);
    const double reach = layout.low.cwiseAbs().maxCoeff() + across;
    if (across > kMostAcross) {
        throw Error(
            code, in_words("progressive stream: the grid is ", across, " across: expected at most ",
                           kMostAcross,
                           "; give the cloud in a larger unit, or without points that are far "
                           "from all others"));
    }
    if (reach > kFarthest) {
        throw Error(code, in_words("progressive stream: the grid reaches ", reach,
                                   " from the origin: expected at most ", kFarthest,
                                   "; give the cloud in a larger unit"));
    }
}

ProgressiveAttribute read_attribute(Reader& in) {
    ProgressiveAttribute attribute;
    attribute.name = in.text(in.get<std::uint8_t>());
    if (!is_attribute_name(attribute.name))
        malformed("the name of an attribute is not " + std::string(kAttributeNameRule));
    attribute.type = in.get<std::uint8_t>();
    require_range("type of an attribute", attribute.type, 0, kTypes - 1);
    attribute.components = in.get<std::uint8_t>();
    require_range("components of an attribute", attribute.components, 1, 255);
    const auto reduction = in.get<std::uint8_t>();
    require_range("reduction of an attribute", reduction, 0, 4);
    attribute.reduction = static_cast<Reduction>(reduction);
    attribute.bits = in.get<std::uint8_t>();
    require_range("bits of an attribute", attribute.bits, 0, attribute.type == kFloat ? 32 : 0);
    attribute.low = in.finite("the lowest value of an attribute");
    attribute.step = in.finite("the step of an attribute");
    return attribute;
}

void read_batches(Reader& in, std::size_t count, ProgressiveLayout& layout) {
    std::uint32_t points = 0;
    unsigned shift = layout.grid_bits - 1U;
    const std::size_t channels = layout.channels().size();
    for (std::size_t b = 0; b < count; ++b) {
        ProgressiveLayout::Batch batch;
        batch.points = in.get<std::uint32_t>();
        batch.bytes = in.get<std::uint32_t>();
        batch.shift = in.get<std::uint8_t>();
        batch.lift = in.get<std::uint8_t>();
        batch.block_bits = in.get<std::uint8_t>();
        batch.sharpening = in.get<std::uint8_t>();
        batch.mean_error = in.get<float>();
        require_range("points up to a batch", batch.points, std::max(points, 1U), layout.points);
        require_range("shift of a batch", batch.shift, 0, shift);
        require_range("lift of a batch", batch.lift, 0, layout.grid_bits - batch.shift);
        require_range("bits of the blocks of a batch", batch.block_bits, 0, kMostGridBits);
        if (batch.points - points > ProgressiveLayout::most_points(batch.bytes, channels))
            malformed("a batch of " + std::to_string(batch.bytes) + " bytes cannot hold " +
                      std::to_string(batch.points - points) + " points");
        points = batch.points;
        shift = batch.shift;
        layout.batches.push_back(batch);
    }
    if (points != layout.points || shift != 0 || layout.batches.back().sharpening != 0)
        malformed("the batches do not add up to the whole");
}

}  // namespace

std::vector<Channel> ProgressiveLayout::channels() const {
    std::vector<Channel> channels;
    const auto add_group = [&](unsigned count, unsigned bits) {
        for (unsigned c = 0; c < count; ++c) channels.push_back({bits, c > 0});
    };
    if (normals) add_group(2, normal_bits);
    if (colors) add_group(3, 8);
    if (alpha) add_group(1, 8);
    constexpr std::array<unsigned, kTypes> kBits = {8, 8, 16, 16, 32, 32, 32, 32};
    for (const ProgressiveAttribute& attribute : attributes) {
        add_group(attribute.components * attribute.channels(),
                  attribute.bits > 0 ? attribute.bits : kBits[attribute.type]);
    }
    return channels;
}

double ProgressiveLayout::sharpening(std::size_t number, std::size_t count) const noexcept {
    if (number == batches.size()) return 0;
    const Batch& now = batches[number];
    const Batch before = number == 0 ? Batch{} : batches[number - 1];
    if (count == before.points) return static_cast<double>(before.sharpening) / kSharpeningUnit;
    const double part = static_cast<double>(count - before.points) / (now.points - before.points);
    return (before.sharpening + part * (now.sharpening - before.sharpening)) / kSharpeningUnit;
}

unsigned ProgressiveLayout::sharpening_block_bits(std::size_t number) const noexcept {
    constexpr unsigned kMost = 30;
    const unsigned shift = batches[number == 0 ? 0 : number - 1].shift;
    return std::min(batches[number].block_bits + shift, kMost);
}

std::vector<std::byte> write_header(const ProgressiveLayout& layout) {
    require_reach(layout, ErrorCode::InvalidArgument);
    ByteWriter out;
    out.put(kMagic);
    out.put(kVersion);
    out.put(static_cast<std::uint8_t>((layout.normals ? 1 : 0) | (layout.colors ? 2 : 0) |
                                      (layout.alpha ? 4 : 0) | (layout.double_precision ? 8 : 0)));
    out.put(layout.grid_bits);
    out.put(layout.normal_bits);
    out.put(std::uint32_t{0});  // its own length, once that is known
    out.put(layout.points);
    out.put(static_cast<std::uint16_t>(layout.attributes.size()));
    out.put(static_cast<std::uint16_t>(layout.batches.size()));
    out.put(layout.step);
    out.put(layout.low);
    out.put(layout.origin);
    for (const ProgressiveAttribute& attribute : layout.attributes) {
        out.put(static_cast<std::uint8_t>(attribute.name.size()));
        out.put(std::string_view(attribute.name));
        out.put(attribute.type);
        out.put(attribute.components);
        out.put(static_cast<std::uint8_t>(attribute.reduction));
        out.put(attribute.bits);
        out.put(attribute.low);
        out.put(attribute.step);
    }
    for (const ProgressiveLayout::Batch& batch : layout.batches) {
        out.put(batch.points);
        out.put(batch.bytes);
        out.put(batch.shift);
        out.put(batch.lift);
        out.put(batch.block_bits);
        out.put(batch.sharpening);
        out.put(batch.mean_error);
    }
    const auto length =
        std::bit_cast<std::array<std::byte, 4>>(static_cast<std::uint32_t>(out.bytes.size()));
    std::ranges::copy(length, out.bytes.begin() + kPreamble - 4);
    return std::move(out.bytes);
}

std::optional<std::size_t> header_length(std::span<const std::byte> bytes) {
    Reader in(bytes.first(std::min(bytes.size(), kPreamble)));
    const std::string magic = in.text(std::min(bytes.size(), kMagic.size()));
    if (!kMagic.starts_with(magic)) malformed("it does not start with 'STPC'");
    if (bytes.size() < kPreamble) return std::nullopt;
    if (const auto version = in.get<std::uint8_t>(); version != kVersion) {
        throw Error(ErrorCode::UnsupportedFormat,
                    "progressive stream of version " + std::to_string(version) + ": expected 3");
    }
    in.text(3);
    const auto length = in.get<std::uint32_t>();
    require_range("length of the header", length, kPreamble, kMostHeader);
    return length;
}

ProgressiveLayout parse_header(std::span<const std::byte> bytes, const DecodeLimits& limits) {
    Reader in(bytes);
    in.text(5);
    ProgressiveLayout layout;
    const auto flags = in.get<std::uint8_t>();
    require_range("flags", flags, 0, 15);
    layout.normals = (flags & 1) != 0;
    layout.colors = (flags & 2) != 0;
    layout.alpha = (flags & 4) != 0;
    layout.double_precision = (flags & 8) != 0;
    if (layout.alpha && !layout.colors)
        throw Error(
            ErrorCode::MalformedInput,
            "progressive stream: flags " + std::to_string(flags) + ": alpha without colours");
    layout.grid_bits = in.get<std::uint8_t>();
    require_range("bits of the grid", layout.grid_bits, 1, kMostGridBits);
    layout.normal_bits = in.get<std::uint8_t>();
    require_range("bits of normals", layout.normal_bits, 2, 16);
    in.text(4);
    layout.points = in.get<std::uint32_t>();
    require_range("points", layout.points, 1, UINT32_MAX);
    if (layout.points > limits.max_points) {
        throw Error(ErrorCode::TooLarge, "progressive stream of " + std::to_string(layout.points) +
                                             " points: expected at most " +
                                             std::to_string(limits.max_points));
    }
    const auto attributes = in.get<std::uint16_t>();
    if (attributes > limits.max_attributes) {
        throw Error(ErrorCode::TooLarge, "progressive stream with " + std::to_string(attributes) +
                                             " attributes: expected at most " +
                                             std::to_string(limits.max_attributes));
    }
    const auto batches = in.get<std::uint16_t>();
    require_range("number of batches", batches, 1, kMostBatches);
    layout.step = in.finite("the step of the grid");
    if (!(layout.step > 0)) malformed("the step of the grid is not positive");
    layout.low = in.place("the corner of the grid");
    layout.origin = in.place("the origin");
    require_reach(layout, ErrorCode::MalformedInput);
    for (unsigned a = 0; a < attributes; ++a) layout.attributes.push_back(read_attribute(in));
    read_batches(in, batches, layout);
    if (!in.at_end()) malformed("the header is longer than its contents");
    return layout;
}

}  // namespace stipple
