#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

// A binary range coder (Martin 1979; carries as in LZMA). Encoder and decoder have the same
// members, each taking the value to write and returning the value that the other side sees, so that
// a model is written once for both.

namespace stipple {

/// How probable it is that a bit is 0, from the bits seen: their mean at first, then one that
/// forgets.
class AdaptiveBit {
public:
    std::uint32_t share_of(std::uint32_t range) const noexcept { return (range >> 16U) * zero_; }
    void update(bool bit) noexcept {
        const unsigned flip = bit ? 0 : 65'535;  // no branch: bits are hard to foretell
        const unsigned against = zero_ ^ flip;
        zero_ =
            static_cast<std::uint16_t>((against - (against >> std::bit_width(seen_ + 1U))) ^ flip);
        seen_ = static_cast<std::uint16_t>(seen_ + (seen_ < kMemory ? 1 : 0));
    }

private:
    static constexpr std::uint16_t kMemory = 63;
    std::uint16_t zero_ = 1U << 15U;  ///< of 2^16; stays within 127..65,408
    std::uint16_t seen_ = 0;
};

inline constexpr unsigned kMostDirectBits = 16;

class RangeEncoder {
public:
    bool bit(AdaptiveBit& model, bool value) {
        const std::uint32_t zero = model.share_of(range_);
        if (value) {
            low_ += zero;
            range_ -= zero;
        } else {
            range_ = zero;
        }
        model.update(value);
        normalize();
        return value;
    }

    /// `count` bits that are as often 0 as 1; at most `kMostDirectBits`.
    std::uint32_t direct(std::uint32_t value, unsigned count) {
        range_ >>= count;
        low_ += static_cast<std::uint64_t>(range_) * value;
        normalize();
        return value;
    }

    /// The bytes of all that was written. Zeros at the end are left out: the decoder reads them
    /// anyway.
    std::vector<std::byte> finish() {
        for (int i = 0; i < 5; ++i) shift_out();
        while (!bytes_.empty() && bytes_.back() == std::byte{0}) bytes_.pop_back();
        return std::move(bytes_);
    }

private:
    void normalize() {
        while (range_ < 1U << 24U) {
            range_ <<= 8U;
            shift_out();
        }
    }

    void shift_out() {
        if (low_ < 0xFF00'0000U || low_ > 0xFFFF'FFFFU) {
            const auto carry = static_cast<std::uint8_t>(low_ >> 32U);
            for (; waiting_ > 0; --waiting_) {
                if (started_) bytes_.push_back(static_cast<std::byte>(last_ + carry));
                started_ = true;  // the first byte is always 0
                last_ = 0xFF;
            }
            last_ = static_cast<std::uint8_t>(low_ >> 24U);
        }
        ++waiting_;
        low_ = (low_ & 0x00FF'FFFFU) << 8U;
    }

    std::uint64_t low_ = 0;
    std::uint32_t range_ = 0xFFFF'FFFFU;
    std::uint8_t last_ = 0;
    std::uint64_t waiting_ = 1;
    bool started_ = false;
    std::vector<std::byte> bytes_;
};

/// Reads zeros behind the end of its bytes.
class RangeDecoder {
public:
    /// Starts at the first of `bytes`, which may grow and move: they are given anew before each
    /// use.
    void start(std::span<const std::byte> bytes) {
        use(bytes);
        at_ = 0;
        range_ = 0xFFFF'FFFFU;
        code_ = 0;
        for (int i = 0; i < 4; ++i) code_ = code_ << 8U | next();
    }
    void use(std::span<const std::byte> bytes) noexcept { bytes_ = bytes; }
    std::size_t position() const noexcept { return at_; }

    bool bit(AdaptiveBit& model, bool /*value*/ = false) {
        const std::uint32_t zero = model.share_of(range_);
        const bool value = code_ >= zero;
        const std::uint32_t mask = 0U - static_cast<std::uint32_t>(value);
        code_ -= zero & mask;
        range_ = zero + (mask & (range_ - 2 * zero));
        model.update(value);
        normalize();
        return value;
    }

    std::uint32_t direct(std::uint32_t /*value*/, unsigned count) {
        range_ >>= count;
        const std::uint32_t value = std::min(code_ / range_, (1U << count) - 1U);
        code_ -= value * range_;
        normalize();
        return value;
    }

private:
    void normalize() {
        while (range_ < 1U << 24U) {
            range_ <<= 8U;
            code_ = code_ << 8U | next();
        }
    }
    std::uint32_t next() noexcept {
        return at_ < bytes_.size() ? std::to_integer<std::uint32_t>(bytes_[at_++]) : 0;
    }

    std::span<const std::byte> bytes_;
    std::size_t at_ = 0;
    std::uint32_t range_ = 0;
    std::uint32_t code_ = 0;
};

}  // namespace stipple
