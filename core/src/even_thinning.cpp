#include "even_thinning.hpp"

#include "first_touch.hpp"
#include "parallel_for.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace stipple {

namespace {

/// Equal cubes over a box; what is outside counts to the nearest.
class Cells {
public:
    /// About `wanted` cubes where a surface goes through, fewer where all would be too many.
    Cells(const Aabb& box, double wanted) : low_(box.min) {
        constexpr double kMost = 1U << 18U, kGrowth = 1.1;
        const Vec3d size = box.max - box.min;
        const double area = size.x() * size.y() + size.y() * size.z() + size.z() * size.x();
        double side = std::max(std::sqrt(area / wanted), box.diagonal() / wanted);
        Vec3d count = Vec3d::Ones();
        while (side > 0) {
            count = (size / side).array().floor() + 1.0;
            if (count.prod() <= kMost) break;
            side *= kGrowth;
        }
        per_unit_ = side > 0 ? 1 / side : 0;
        last_ = (count.array() - 1.0).cast<float>();
        row_ = static_cast<std::uint32_t>(count.x());
        layer_ = row_ * static_cast<std::uint32_t>(count.y());
        size_ = layer_ * static_cast<std::uint32_t>(count.z());
    }

    std::size_t size() const noexcept { return size_; }

    /// Calls take(i, cell) for each point of a cloud.
    template <typename Take>
    void for_each(const PointCloud& cloud, const RunContext& context, Take&& take) const {
        const auto scale = static_cast<float>(per_unit_);
        const Vec3f shift = (per_unit_ * (cloud.origin - low_)).cast<float>();
        for_blocks_in_order(cloud.size(), context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) {
                const Vec3f at = scale * cloud.positions[i] + shift;
                const auto cell = [&](int axis) {
                    return static_cast<std::uint32_t>(
                        std::min(std::max(at[axis], 0.0F), last_[axis]));
                };
                take(i, cell(0) + row_ * cell(1) + layer_ * cell(2));
            }
        });
    }

private:
    Vec3d low_;
    double per_unit_ = 0;
    Vec3f last_;
    std::uint32_t row_ = 1, layer_ = 1, size_ = 1;
};

constexpr std::uint32_t kOfCell = 16, kOfEach = 16, kPart = 3;
constexpr std::uint64_t kOthersOfCell = 8, kFew = 100'000;

/// The points of a cell.
struct Share {
    std::uint32_t stay = 0, all = 0;
    std::uint32_t due = 0;  ///< so much, of `all`, of the next one that stays

    void allow(std::uint32_t points) noexcept {
        stay = std::min(all, std::max(points, all / kPart));
        due = all / 2;
    }
    bool takes_next() noexcept {
        due += stay;
        if (due < all) return false;
        due -= all;
        return true;
    }
};

}  // namespace

std::optional<PointCloud> thinned_for(const PointCloud& other, const PointCloud& cloud,
                                      const RunContext& context) {
    const std::uint64_t about = other.size() * (kOfEach + kOfCell / kOthersOfCell);
    if (other.empty() || cloud.size() <= kFew || about >= cloud.size() / 2) return std::nullopt;
    const Cells cells(bounds(cloud), static_cast<double>(other.size()) / kOthersOfCell);
    std::vector<Share> shares(cells.size());
    auto cell_of = made_in_blocks<std::vector<std::uint32_t>>(cloud.size(), context);
    cells.for_each(other, context,
                   [&](std::size_t, std::uint32_t cell) { shares[cell].stay += kOfEach; });
    cells.for_each(cloud, context, [&](std::size_t i, std::uint32_t cell) {
        cell_of[i] = cell;
        ++shares[cell].all;
    });
    std::size_t total = 0;
    for (Share& share : shares) {
        share.allow(share.stay + kOfCell);
        total += share.stay;
    }
    PointCloud thinned;
    thinned.origin = cloud.origin;
    thinned.positions.reserve(total);
    for_blocks_in_order(cloud.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i)
            if (shares[cell_of[i]].takes_next()) thinned.positions.push_back(cloud.positions[i]);
    });
    return thinned;
}

}  // namespace stipple
