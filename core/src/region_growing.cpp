#include "region_growing.hpp"

#include "cluster_kernels.hpp"
#include "first_touch.hpp"
#include "point_blocks.hpp"
#include "random.hpp"
#include "symmetric_eigen.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

// Follows: Pauly, Gross, Kobbelt 2002, §3.1. The paper leaves open how far a region may reach
// around those that were there before and which of its neighbours is the next seed. Both decide how
// even the regions are: measured were reaches of 1.1 to 1.6 R and seeds from the nearest free point
// to 2.1 R away.

namespace stipple {

namespace {

constexpr float kReach = 1.3F;           // R: how far a region extends
constexpr float kNextSeed = 1.75F;       // R: how far away the next seed should be
constexpr float kLook = 1.85F;           // R: how far away it may be
constexpr float kFirstLook = 2.1F;       // typical R: what is looked through first
constexpr float kFirstCount = 1.4F;      // typical R: and where taken points are looked at, too
constexpr float kMostGrowth = 2.0F;      // of R from one region to the next
constexpr float kPatience = 1.25F;       // growth of the typical R where too few points are found
constexpr std::size_t kMostLooked = 32;  // n_max: beyond, one looks nearer
constexpr std::uint64_t kFirstSize = 8;  // tried under a bound on the variation

/// The m-th smallest of the distances, behind which eight stand that are infinite; 1 <= m <=
/// `up_to`, how many of them are at most `high`.
///
/// On a surface the count grows with the squared distance: a few steps between counts leave a
/// handful to choose from.
float mth_smallest(const std::vector<float>& distances_sq, std::size_t size, float high,
                   std::size_t up_to, std::size_t m, std::vector<float>& buffer) {
    float low = -1;  // in (low, high]
    std::size_t below = 0;
    for (int step = 0; step < 4 && up_to - below > 8; ++step) {
        const float part =
            (static_cast<float>(m - below) - 0.5F) / static_cast<float>(up_to - below);
        const float from = std::max(low, 0.0F), guess = from + part * (high - from);
        if (!(guess > low && guess < high)) break;
        const std::size_t count = cluster_kernels().count(distances_sq.data(), size, guess);
        (count >= m ? high : low) = guess;
        (count >= m ? up_to : below) = count;
    }
    buffer.resize(up_to - below + PointBlocks::kSlack);
    const std::size_t left =
        cluster_kernels().values_between(distances_sq.data(), size, low, high, buffer.data());
    const auto wanted = buffer.begin() + static_cast<std::ptrdiff_t>(m - below - 1);
    std::nth_element(buffer.begin(), wanted, buffer.begin() + static_cast<std::ptrdiff_t>(left));
    return *wanted;
}

/// What lies within some distance of a seed.
struct Surroundings {
    std::vector<float> all_sq;   ///< squared distances of all points nearby, the seed included
    std::vector<float> free_sq;  ///< and of those farther off, too, that are not taken,
    std::vector<Index> free;     ///< which are here
    std::size_t all_count = 0, free_count = 0;

    /// Finds all points within `counted` of q, and the free ones within `radius`, which is no less.
    /// @return whether there are no more than `limit` of them, and perhaps a block; if there are
    /// more, not all of them are here.
    bool look(const PointBlocks& blocks, const Vec3f& q, float counted, float radius,
              std::size_t limit) {
        const float counted_sq = counted * counted, radius_sq = radius * radius;
        all_count = free_count = 0;
        const std::array<float, 3> center = {q.x(), q.y(), q.z()};
        const SampleSpan samples = blocks.samples();
        const ClusterKernels& kernels = cluster_kernels();
        blocks.find(q, radius_sq, [&](Index begin, Index end) {
            make_room(end - begin);
            const NearbyOutput out =
                kernels.nearby(samples, blocks.taken(), begin, end, center, counted_sq, radius_sq,
                               {&all_sq[all_count], &free_sq[free_count], &free[free_count]});
            all_count = static_cast<std::size_t>(out.all_sq - all_sq.data());
            free_count = static_cast<std::size_t>(out.free_sq - free_sq.data());
            return all_count + free_count <= limit;
        });
        make_room(0);
        constexpr float kFar = std::numeric_limits<float>::infinity();
        std::fill_n(&all_sq[all_count], PointBlocks::kSlack, kFar);
        std::fill_n(&free_sq[free_count], PointBlocks::kSlack, kFar);
        return all_count + free_count <= limit;
    }

private:
    /// For `more` points, and some behind them.
    void make_room(std::size_t more) {
        const std::size_t count = std::max(all_count, free_count) + more;
        if (count + PointBlocks::kSlack <= all_sq.size()) return;
        const std::size_t size = 2 * count + 64;
        all_sq.resize(size);
        free_sq.resize(size);
        free.resize(size);
    }
};

/// The scatter of points as they come one by one, relative to the first.
class RunningScatter {
public:
    explicit RunningScatter(const Vec3f& reference) : reference_(reference) {}

    void add(const Vec3f& p) noexcept {
        const Vec3d d = (p - reference_).cast<double>();
        ++count_;
        sum_ += d;
        squares_.xx += d.x() * d.x();
        squares_.xy += d.x() * d.y();
        squares_.xz += d.x() * d.z();
        squares_.yy += d.y() * d.y();
        squares_.yz += d.y() * d.z();
        squares_.zz += d.z() * d.z();
    }
    std::size_t size() const noexcept { return static_cast<std::size_t>(count_); }
    double variation() const noexcept {  // Eq. 5
        const Symmetric3 a = scatter();
        const double total = a.trace();
        return total > 0 ? std::max(0.0, eigenvalues(a)[0]) / total : 0.0;
    }
    /// Whether the variation is above `bound`: whether the scatter less `bound` of its trace is
    /// positive definite.
    bool varies_more_than(double bound) const noexcept {
        const Symmetric3 a = scatter();
        const double shift = bound * a.trace();
        const double xx = a.xx - shift, yy = a.yy - shift, zz = a.zz - shift;
        const double minor = xx * yy - a.xy * a.xy;
        return xx > 0 && minor > 0 &&
               minor * zz + 2 * a.xy * a.xz * a.yz > xx * a.yz * a.yz + yy * a.xz * a.xz;
    }

private:
    Symmetric3 scatter() const noexcept {
        const Vec3d m = sum_ / count_;
        return {squares_.xx - m.x() * sum_.x(), squares_.xy - m.x() * sum_.y(),
                squares_.xz - m.x() * sum_.z(), squares_.yy - m.y() * sum_.y(),
                squares_.yz - m.y() * sum_.z(), squares_.zz - m.z() * sum_.z()};
    }

    Vec3f reference_;
    double count_ = 0;
    Vec3d sum_ = Vec3d::Zero();
    Symmetric3 squares_;
};

class Growth {
public:
    Growth(std::span<const Vec3f> points, const RegionBounds& bounds, const RunContext& context)
        : points_(points),
          bounds_{std::min<std::uint64_t>(bounds.max_size, points.size()), bounds.max_variation},
          blocks_(points, block_size(bounds_), {}, context),
          taken_(points.size()) {
        result_.members.reserve(points.size());
        size_ = bounded() ? std::min(kFirstSize, bounds_.max_size) : bounds_.max_size;
    }

    Regions run(Index first_seed, const RunContext& context) {
        Vec3f seed = scaled(first_seed);
        spacing_ = first_spacing(seed);
        while (true) {
            context.throw_if_stopped();
            constexpr std::size_t kBetweenReports = 64;  // regions
            const std::size_t regions = result_.regions.size();
            if (regions % kBetweenReports == 0) {
                context.checkpoint(static_cast<double>(result_.members.size()) /
                                   static_cast<double>(points_.size()));
            }
            if (regions == result_.regions.capacity())
                reserve_in_blocks(result_.regions, 2 * regions + kBetweenReports, context);
            const Extent extent = grow(seed);
            if (result_.members.size() == points_.size()) break;
            seed = next_seed(extent);
        }
        result_.scale = blocks_.scale();
        return std::move(result_);
    }

private:
    static constexpr std::size_t kNoLimit = std::numeric_limits<std::size_t>::max();
    struct Ordered {
        std::uint64_t key;  ///< squared distance, then number
        Index place;
    };
    struct Prefix {
        std::size_t size;
        double variation;
    };

    /// What takes the fewest instructions over the scans tried.
    static std::size_t block_size(const RegionBounds& bounds) {
        return std::clamp<std::size_t>(3 * bounds.max_size / 2, 64, 512);
    }
    bool bounded() const noexcept { return std::isfinite(bounds_.max_variation); }
    Vec3f scaled(Index point) const noexcept { return points_[point] * blocks_.scale(); }

    /// R over the root of the size, for the first seed.
    float first_spacing(const Vec3f& seed) {
        float radius = 0.25F * blocks_.extent() *
                       std::sqrt(static_cast<float>(size_) / static_cast<float>(points_.size()));
        while (near_.look(blocks_, seed, radius, radius, kNoLimit), near_.all_count < size_)
            radius *= 2;
        return radius_of_size(radius) / std::sqrt(static_cast<float>(size_));
    }

    /// R, where `counted` is no less.
    float radius_of_size(float counted) {
        return std::sqrt(mth_smallest(near_.all_sq, near_.all_count, counted * counted,
                                      near_.all_count, size_, buffer_));
    }

    /// Finds R of a region of `size_` points, and the free ones within `kLook` R.
    float survey(const Vec3f& seed) {
        const float typical = spacing_ * std::sqrt(static_cast<float>(size_));
        const float most = kMostGrowth * typical;
        float counted = kFirstCount * typical, looked = kFirstLook * typical;
        const std::size_t limit = kMostLooked * size_;
        constexpr float kNothing = std::numeric_limits<float>::min();  // nearer is at one place
        while (!near_.look(blocks_, seed, counted, looked, limit) && looked > kNothing) {
            constexpr float kNearer = 0.6F;
            counted *= kNearer;
            looked *= kNearer;
        }
        for (const float farther : {looked, most}) {  // where R is more, or a crowd stands beyond
            if (near_.all_count >= size_ || counted >= most) break;
            counted = farther;
            looked = std::max(looked, farther);
            near_.look(blocks_, seed, counted, looked, kNoLimit);
        }
        float radius = most;
        if (near_.all_count >= size_) radius = std::min(most, radius_of_size(counted));
        if (looked < kLook * radius) {
            looked = kLook * radius;
            near_.look(blocks_, seed, radius, looked, kNoLimit);
        }
        return radius;
    }

    /// Learns from R how far apart points are here.
    void follow_density(float radius) {
        constexpr float kLeast = 1e-6F;  // of the extent: what comes after coincident points
        const float root = std::sqrt(static_cast<float>(size_));
        const bool is_full = radius < kMostGrowth * spacing_ * root;
        const float spacing = is_full ? radius / root : kPatience * spacing_;
        spacing_ = std::clamp(spacing, kLeast * blocks_.extent(), 2 * blocks_.extent());
    }

    /// How far a region extends: R, and what is left of it where the variation ended the region.
    struct Extent {
        float radius, own_radius;
    };

    Extent grow(const Vec3f& seed) {
        while (true) {
            const float radius = survey(seed);
            follow_density(radius);
            collect(seed, kReach * radius);
            if (!bounded()) {
                take(seed, chosen_.size());
                return {radius, radius};
            }
            const Prefix kept = longest_within_variation(seed);
            if (kept.size == size_ && size_ < bounds_.max_size) {
                size_ = std::min(2 * size_, bounds_.max_size);
                continue;
            }
            const bool cut_short = kept.size < chosen_.size();
            float own_radius = radius;
            if (cut_short)
                own_radius = (blocks_.samples().position(chosen_[kept.size - 1]) - seed).norm();
            take(seed, kept.size);
            result_.regions.back().variation = kept.variation;
            result_.regions.back().is_bent = cut_short;
            size_ = std::clamp<std::uint64_t>(2 * kept.size, std::min(kFirstSize, bounds_.max_size),
                                              bounds_.max_size);
            return {radius, own_radius};
        }
    }

    /// Chooses the nearest free points within `reach`, `size_` at most, in any order.
    void collect(const Vec3f& seed, float reach) {
        float limit = reach * reach;
        const std::size_t free =
            cluster_kernels().count(near_.free_sq.data(), near_.free_count, limit);
        if (free > size_)
            limit = mth_smallest(near_.free_sq, near_.free_count, limit, free, size_, buffer_);
        chosen_.resize(near_.free_count + PointBlocks::kSlack);
        chosen_.resize(cluster_kernels().places_between(near_.free_sq.data(), near_.free.data(),
                                                        near_.free_count, -1.0F, limit,
                                                        chosen_.data()));
        if (chosen_.size() > size_) {  // among equal distances
            sort_chosen(seed);
            chosen_.resize(size_);
        }
    }

    /// Puts what was chosen in order of distance.
    void sort_chosen(const Vec3f& seed) {
        order_.clear();
        for (const Index place : chosen_) {
            const Vec3f d = blocks_.samples().position(place) - seed;
            const float distance_sq = d.x() * d.x() + d.y() * d.y() + d.z() * d.z();
            const std::uint64_t high = std::bit_cast<std::uint32_t>(distance_sq);
            order_.push_back({high << 32U | blocks_.samples().index[place], place});
        }
        std::ranges::sort(order_, {}, &Ordered::key);
        std::ranges::transform(order_, chosen_.begin(), &Ordered::place);
    }

    /// The most of the nearest chosen points within the bound on the variation; sorts them where
    /// those are not all.
    Prefix longest_within_variation(const Vec3f& seed) {
        RunningScatter scatter(seed);
        for (const Index place : chosen_) scatter.add(blocks_.samples().position(place));
        if (!scatter.varies_more_than(bounds_.max_variation))
            return {chosen_.size(), scatter.variation()};
        sort_chosen(seed);
        scatter = RunningScatter(seed);
        RunningScatter longest = scatter;
        for (const Index place : chosen_) {
            scatter.add(blocks_.samples().position(place));
            if (!scatter.varies_more_than(bounds_.max_variation)) longest = scatter;
        }
        return {longest.size(), longest.variation()};
    }

    /// Makes a region of the first `count` chosen points.
    void take(const Vec3f& seed, std::size_t count) {
        Region region;
        region.begin = static_cast<Index>(result_.members.size());
        Vec3f offsets = Vec3f::Zero();
        const SampleSpan samples = blocks_.samples();
        for (const Index place : std::span(chosen_).first(count)) {
            blocks_.take(place);
            taken_[samples.index[place]] = true;
            result_.members.push_back(samples.index[place]);
            offsets += samples.position(place) - seed;
        }
        region.end = static_cast<Index>(result_.members.size());
        region.centroid = seed + offsets / static_cast<float>(count);
        result_.regions.push_back(region);
    }

    Vec3f next_seed(const Extent& extent) {
        const float limit = (kLook * extent.radius) * (kLook * extent.radius);
        const float wanted = (kNextSeed * extent.own_radius) * (kNextSeed * extent.own_radius);
        std::pair<float, Index> best = {std::numeric_limits<float>::infinity(), 0};
        Index best_place = 0;
        for (std::size_t i = 0; i < near_.free_count; i += 4) {
            const Float4 d = load(&near_.free_sq[i]), miss = d < wanted ? wanted - d : d - wanted;
            unsigned lanes = lane_bits((d <= limit) & (miss <= best.first));
            for (; lanes != 0; lanes &= lanes - 1) {
                const auto lane = static_cast<std::size_t>(std::countr_zero(lanes));
                const Index place = near_.free[i + lane];
                if (blocks_.is_taken(place)) continue;
                const std::pair candidate = {miss[lane], blocks_.samples().index[place]};
                if (candidate < best) {
                    best = candidate;
                    best_place = place;
                }
            }
        }
        if (std::isfinite(best.first)) return blocks_.samples().position(best_place);
        while (taken_[first_free_]) ++first_free_;
        return scaled(first_free_);
    }

    std::span<const Vec3f> points_;
    RegionBounds bounds_;
    PointBlocks blocks_;
    std::vector<bool> taken_;  ///< by number in the cloud
    Index first_free_ = 0;
    std::uint64_t size_;  ///< n_max, or what is tried under a bound on the variation
    float spacing_ = 0;   ///< typical R over the root of the size
    Surroundings near_;
    std::vector<Index> chosen_;  ///< their places
    std::vector<Ordered> order_;
    std::vector<float> buffer_;
    Regions result_;
};

}  // namespace

Regions grow_regions(std::span<const Vec3f> points, const RegionBounds& bounds, std::uint64_t seed,
                     const RunContext& context) {
    Growth growth(points, bounds, context);
    const auto first = static_cast<Index>(below(random_bits(seed, 0), points.size()));
    return growth.run(first, context);
}

}  // namespace stipple
