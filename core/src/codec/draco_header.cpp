#include "codec/draco_header.hpp"

#include "stipple/error.hpp"

#include <string>
#include <vector>

namespace stipple {

namespace {

[[noreturn]] void fail(std::size_t byte, const std::string& what) {
    throw Error(ErrorCode::MalformedInput, "Draco, byte " + std::to_string(byte) + ": " + what);
}

class Bytes {
public:
    explicit Bytes(std::span<const std::byte> file) : file_(file) {}

    std::size_t position() const noexcept { return position_; }
    void skip(std::uint64_t bytes) {
        if (bytes > file_.size() - position_) fail(position_, "the file ends inside the header");
        position_ += bytes;
    }
    std::uint64_t little_endian(unsigned bytes) {
        skip(bytes);
        std::uint64_t value = 0;
        for (unsigned i = bytes; i != 0; --i) {
            value = value << 8 | std::to_integer<std::uint64_t>(file_[position_ - bytes + i - 1]);
        }
        return value;
    }
    /// Seven bits a byte, the lowest first.
    std::uint64_t varint() {
        std::uint64_t value = 0;
        for (unsigned shift = 0; shift < 63; shift += 7) {
            const std::uint64_t byte = little_endian(1);
            value |= (byte & 0x7f) << shift;
            if (byte < 0x80) return value;
        }
        fail(position_, "a number of more than nine bytes");
    }

private:
    std::span<const std::byte> file_;
    std::size_t position_ = 0;
};

void skip_entries(Bytes& bytes) {
    for (std::uint64_t left = bytes.varint(); left != 0; --left) {
        bytes.skip(bytes.little_endian(1));  // the name
        bytes.skip(bytes.varint());          // the value
    }
}

/// Metadata may hold metadata: `open` has, for each level, how many are still to come.
void skip_metadata(Bytes& bytes) {
    constexpr std::size_t kDeepest = 1000;
    skip_entries(bytes);
    std::vector<std::uint64_t> open{bytes.varint()};
    while (!open.empty()) {
        if (open.back() == 0) {
            open.pop_back();
            continue;
        }
        --open.back();
        bytes.skip(bytes.little_endian(1));
        skip_entries(bytes);
        open.push_back(bytes.varint());
        if (open.size() > kDeepest) fail(bytes.position(), "metadata nested over 1000 deep");
    }
}

constexpr unsigned version(unsigned major, unsigned minor) {
    return major << 8 | minor;
}

}  // namespace

DracoHeader parse_draco_header(std::span<const std::byte> file) {
    Bytes bytes(file);
    bytes.skip(5);  // DRACO
    const auto major = static_cast<unsigned>(bytes.little_endian(1));
    const unsigned bitstream = version(major, static_cast<unsigned>(bytes.little_endian(1)));
    const std::uint64_t type = bytes.little_endian(1);
    const std::uint64_t method = bytes.little_endian(1);
    const std::uint64_t flags = bytes.little_endian(2);
    if (major == 0 || major > 2) {
        throw Error(ErrorCode::UnsupportedFormat, "Draco: version " + std::to_string(major) + "." +
                                                      std::to_string(bitstream & 0xff) +
                                                      ": expected 1.x or 2.x");
    }
    if (type > 1)
        fail(7, "geometry type " + std::to_string(type) + ": expected 0 (points) or 1 (mesh)");
    if (method > 1) fail(8, "encoding method " + std::to_string(method) + ": expected 0 or 1");

    DracoHeader header;
    header.mesh = type == 1;
    header.encoding = method == 0 ? "sequential" : header.mesh ? "edgebreaker" : "kd-tree";
    constexpr std::uint64_t kHasMetadata = 0x8000;
    if (bitstream >= version(1, 3) && (flags & kHasMetadata) != 0) {
        for (std::uint64_t left = bytes.varint(); left != 0; --left) {
            bytes.varint();  // the attribute
            skip_metadata(bytes);
        }
        skip_metadata(bytes);
    }
    if (!header.mesh) {
        header.declared_points = bytes.little_endian(4);
    } else if (method == 0) {
        const bool fixed = bitstream < version(2, 2);
        fixed ? bytes.little_endian(4) : bytes.varint();  // the faces
        header.declared_points = fixed ? bytes.little_endian(4) : bytes.varint();
    } else {
        const bool fixed = bitstream < version(2, 0);
        bytes.skip(1);  // how it was traversed
        if (bitstream < version(2, 2)) fixed ? bytes.little_endian(4) : bytes.varint();
        header.declared_points = fixed ? bytes.little_endian(4) : bytes.varint();
    }
    return header;
}

}  // namespace stipple
