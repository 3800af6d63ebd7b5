#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

// The entropy coder of LAZ: Isenburg, LASzip: lossless compression of LiDAR data, 2013, on Said,
// Introduction to Arithmetic Coding, 2004, whose numbers of bits, periods and rounding every
// decoder has to share.

namespace stipple {

/// How probable a bit is, from those seen.
class LazBit {
public:
    std::uint32_t zero_of(std::uint32_t length) const noexcept { return zero_ * (length >> kBits); }
    void count(bool bit) noexcept {
        zeros_ += bit ? 0 : 1;
        if (--until_update_ == 0) update();
    }

private:
    static constexpr unsigned kBits = 13;
    void update() noexcept {
        seen_ += period_;
        if (seen_ > 1U << kBits) {
            seen_ = (seen_ + 1) / 2;
            zeros_ = (zeros_ + 1) / 2;
            if (zeros_ == seen_) ++seen_;
        }
        zero_ = zeros_ * ((1U << 31U) / seen_) >> (31U - kBits);
        period_ = std::min(64U, 5 * period_ / 4);
        until_update_ = period_;
    }

    std::uint32_t zeros_ = 1, seen_ = 2, zero_ = 1U << (kBits - 1);
    unsigned period_ = 4, until_update_ = 4;
};

/// How probable each of some symbols is, from those seen.
class LazSymbols {
public:
    /// @param symbols  how many there are, 2..2,048.
    explicit LazSymbols(unsigned symbols)
        : counts_(symbols, 1), before_(symbols), period_((symbols + 6) / 2) {
        total_ = symbols;
        settle();
        until_update_ = period_;
    }

    struct Share {
        std::uint32_t before, own;
    };
    /// Of a length, what the symbols before this one have, and itself.
    Share share_of(unsigned symbol, std::uint32_t length) const noexcept {
        const std::uint32_t unit = length >> kBits, before = before_[symbol] * unit;
        const std::uint32_t end =
            symbol + 1 == before_.size() ? length : before_[symbol + 1] * unit;
        return {before, end - before};
    }
    void count(unsigned symbol) {
        ++counts_[symbol];
        if (--until_update_ == 0) update();
    }

private:
    static constexpr unsigned kBits = 15;
    void settle() {
        const std::uint32_t scale = (1U << 31U) / total_;
        std::uint32_t sum = 0;
        for (std::size_t i = 0; i < counts_.size(); ++i) {
            before_[i] = scale * sum >> (31U - kBits);
            sum += counts_[i];
        }
    }
    void update() {
        total_ += period_;
        if (total_ > 1U << kBits) {
            total_ = 0;
            for (std::uint32_t& count : counts_) total_ += count = (count + 1) / 2;
        }
        settle();
        const auto most = static_cast<unsigned>(8 * (counts_.size() + 6));
        period_ = std::min(most, 5 * period_ / 4);
        until_update_ = period_;
    }

    std::vector<std::uint32_t> counts_, before_;
    std::uint32_t total_ = 0;
    unsigned period_, until_update_ = 0;
};

class LazEncoder {
public:
    void bit(LazBit& model, bool value) {
        const std::uint32_t zero = model.zero_of(length_);
        if (value)
            narrow(zero, length_ - zero);
        else
            narrow(0, zero);
        model.count(value);
    }

    void symbol(LazSymbols& model, unsigned value) {
        const auto [before, own] = model.share_of(value, length_);
        narrow(before, own);
        model.count(value);
    }

    /// `count` bits that are as often 0 as 1, at most 32.
    void direct(std::uint32_t value, unsigned count) {
        constexpr unsigned kMostAtOnce = 19, kHalf = 16;
        if (count > kMostAtOnce) {
            direct(value & ((1U << kHalf) - 1), kHalf);
            value >>= kHalf;
            count -= kHalf;
        }
        const std::uint32_t unit = length_ >> count;
        narrow(value * unit, unit);
    }

    /// The bytes of all that was written, with as many behind them as a decoder reads ahead.
    std::vector<std::byte> finish() && {
        const bool is_wide = length_ > 2 * kLeast;
        narrow(is_wide ? kLeast : kLeast / 2, is_wide ? kLeast / 2 : kLeast >> 9U);
        bytes_.insert(bytes_.end(), is_wide ? 3 : 2, std::byte{0});
        return std::move(bytes_);
    }

private:
    static constexpr std::uint32_t kLeast = 1U << 24U;  ///< below it a byte is certain

    void narrow(std::uint32_t before, std::uint32_t length) {
        const std::uint32_t base = base_ + before;
        if (base < base_) carry();
        base_ = base;
        length_ = length;
        while (length_ < kLeast) {
            bytes_.push_back(static_cast<std::byte>(base_ >> 24U));
            base_ <<= 8U;
            length_ <<= 8U;
        }
    }
    void carry() {
        std::size_t at = bytes_.size() - 1;
        while (bytes_[at] == std::byte{0xFF}) bytes_[at--] = std::byte{0};
        bytes_[at] = static_cast<std::byte>(std::to_integer<unsigned>(bytes_[at]) + 1);
    }

    std::vector<std::byte> bytes_;
    std::uint32_t base_ = 0, length_ = 0xFFFFFFFF;
};

/// Integers by how far they are from what was expected: how many bits that takes, by context, and
/// the bits.
class LazIntegers {
public:
    /// @param bits  of the integers, 16 or 32: differences wrap around.
    LazIntegers(unsigned bits, std::size_t contexts)
        : bits_(bits), widths_(contexts, LazSymbols(bits + 1)) {
        for (unsigned width = 1; width < bits + 1; ++width)
            corrections_.emplace_back(1U << std::min(width, kModeled));
    }

    void encode(LazEncoder& to, std::int32_t expected, std::int32_t value, std::size_t context) {
        const unsigned unused = 32 - bits_;
        const std::uint32_t wrapped =
            (static_cast<std::uint32_t>(value) - static_cast<std::uint32_t>(expected)) << unused;
        const std::int32_t off = static_cast<std::int32_t>(wrapped) >> unused;
        // Of width w is what lies in -(2^w - 1)..2^w, and in no narrower such range.
        const std::int64_t folded = off <= 0 ? -std::int64_t{off} : std::int64_t{off} - 1;
        width_ = static_cast<unsigned>(std::bit_width(static_cast<std::uint64_t>(folded)));
        to.symbol(widths_[context], width_);
        if (width_ == 0) return to.bit(sign_, off == 1);
        if (width_ == 32) return;  // only the least of all
        const auto place =
            static_cast<std::uint32_t>(off < 0 ? off + ((std::int64_t{1} << width_) - 1) : off - 1);
        const unsigned low = width_ - std::min(width_, kModeled);
        to.symbol(corrections_[width_ - 1], place >> low);
        if (low > 0) to.direct(place & ((1U << low) - 1), low);
    }

    unsigned width() const noexcept { return width_; }  ///< of the last one

private:
    static constexpr unsigned kModeled = 8;  ///< highest bits of a correction

    unsigned bits_, width_ = 0;
    std::vector<LazSymbols> widths_, corrections_;
    LazBit sign_;
};

/// About the median of the last values: of five, of which now the highest and now the lowest gives
/// way to the next one.
class LazMedian {
public:
    std::int32_t value() const noexcept { return sorted_[2]; }
    void add(std::int32_t v) noexcept {
        auto& s = sorted_;
        if (highest_goes_) {
            highest_goes_ = v < s[2];
            s[4] = v;
            for (std::size_t i = 4; i > 0 && s[i - 1] > s[i]; --i) std::swap(s[i - 1], s[i]);
        } else {
            highest_goes_ = v <= s[2];
            s[0] = v;
            for (std::size_t i = 0; i < 4 && s[i] > s[i + 1]; ++i) std::swap(s[i], s[i + 1]);
        }
    }

private:
    std::array<std::int32_t, 5> sorted_{};
    bool highest_goes_ = true;
};

}  // namespace stipple
