#include "clustering/region_growing.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "base/random.hpp"
#include "base/symmetric_eigen.hpp"
#include "cloud/float4.hpp"
#include "clustering/cluster_kernels.hpp"
#include "clustering/sample_moments.hpp"
#include "clustering/surroundings.hpp"

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
constexpr std::uint64_t kGrowth = 4;     // of it while the bound holds
constexpr std::size_t kRings = 16;       // of one area, after which the variation is looked at
constexpr std::size_t kFew = 16;         // values that are ranked each by all

/// The m-th smallest of a few, 1 <= m <= size <= kFew; behind them there is room for `kFew` in all.
float mth_of_few(float* values, std::size_t size, std::size_t m) {
    std::fill(values + size, values + kFew, std::numeric_limits<float>::infinity());
    std::array<Float4, kFew / 4> groups;
    std::array<Int4, kFew / 4> less{};  // minus how many are less
    for (std::size_t g = 0; g < groups.size(); ++g) groups[g] = load(values + 4 * g);
    for (std::size_t i = 0; i < size; ++i) {
        for (std::size_t g = 0; g < groups.size(); ++g) less[g] += values[i] < groups[g];
    }
    const auto rank = static_cast<std::int32_t>(m - 1);
    Float4 largest{};
    for (std::size_t g = 0; g < groups.size(); ++g)
        largest = larger(-less[g] <= rank ? groups[g] : Float4{}, largest);
    return std::max({largest[0], largest[1], largest[2], largest[3]});
}

/// The m-th smallest of the distances, behind which eight stand that are infinite; 1 <= m <=
/// `up_to`, how many of them are at most `high`.
///
/// On a surface the count grows with the squared distance: a few steps between counts, each a bit
/// past the m-th from the farther end, leave a handful to choose from.
float mth_smallest(const std::vector<float>& distances_sq, std::size_t size, float high,
                   std::size_t up_to, std::size_t m, std::vector<float>& buffer) {
    float low = -1;  // in (low, high]
    std::size_t below = 0;
    for (int step = 0; step < 6 && up_to - below > kFew; ++step) {
        constexpr float kPast = 4;
        const float past = m - below > up_to - m ? -kPast : kPast;
        const auto all = static_cast<float>(up_to - below);
        const float wanted = static_cast<float>(m - below) - 0.5F + past;
        const float from = std::max(low, 0.0F), guess = from + wanted / all * (high - from);
        if (!(guess > low && guess < high)) break;
        const std::size_t count = cluster_kernels().count(distances_sq.data(), size, guess);
        (count >= m ? high : low) = guess;
        (count >= m ? up_to : below) = count;
    }
    buffer.resize(std::max(up_to - below, kFew) + PointBlocks::kSlack);
    const std::size_t left =
        cluster_kernels().values_between(distances_sq.data(), size, low, high, buffer.data());
    if (left <= kFew) return mth_of_few(buffer.data(), left, m - below);
    const auto wanted = buffer.begin() + static_cast<std::ptrdiff_t>(m - below - 1);
    std::nth_element(buffer.begin(), wanted, buffer.begin() + static_cast<std::ptrdiff_t>(left));
    return *wanted;
}

/// Places `begin..end`.
struct Places {
    Index begin, end;

    Index size() const noexcept { return end - begin; }
};

double variation_of(const Symmetric3& scatter) noexcept {  // Eq. 5
    const double total = scatter.trace();
    return total > 0 ? std::max(0.0, eigenvalues(scatter)[0]) / total : 0.0;
}

/// Whether the variation is above `bound`: whether the scatter less `bound` of its trace is
/// positive definite.
bool varies_more_than(double bound, const Symmetric3& a) noexcept {
    const double shift = bound * a.trace();
    const double xx = a.xx - shift, yy = a.yy - shift, zz = a.zz - shift;
    const double minor = xx * yy - a.xy * a.xy;
    return xx > 0 && minor > 0 &&
           minor * zz + 2 * a.xy * a.xz * a.yz > xx * a.yz * a.yz + yy * a.xz * a.xz;
}

/// Points as they come one by one, relative to a reference.
struct Scatter {
    SampleSums sums{};
    std::size_t count = 0;

    void add(const Vec3f& offset) noexcept {
        const Vec3d d = offset.cast<double>();
        const SampleSums terms = {d.x(),         d.y(),         d.z(),
                                  d.x() * d.x(), d.x() * d.y(), d.x() * d.z(),
                                  d.y() * d.y(), d.y() * d.z(), d.z() * d.z()};
        *this += {terms, 1};
    }
    Scatter& operator+=(const Scatter& other) noexcept {
        for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += other.sums[i];
        count += other.count;
        return *this;
    }
    Symmetric3 central() const noexcept { return moments_from(sums, count, Vec3d::Zero()).scatter; }
};

/// Some points relative to a seed.
struct Offsets {
    std::vector<float> x, y, z, distance_sq;

    void resize(std::size_t n) {
        for (auto* const v : {&x, &y, &z, &distance_sq}) v->resize(n);
    }
    void set(std::size_t i, const Vec3f& offset) {
        x[i] = offset.x();
        y[i] = offset.y();
        z[i] = offset.z();
        distance_sq[i] = x[i] * x[i] + y[i] * y[i] + z[i] * z[i];
    }
    Vec3f operator[](std::size_t i) const noexcept { return {x[i], y[i], z[i]}; }
    Scatter scatter() const {
        const SampleSpan all = {x.data(), y.data(), z.data(), nullptr, x.size()};
        return {cluster_kernels().sums(all, {0, 0, 0}), x.size()};
    }
};

/// How far a region extends: R, and what is left of it where the variation ended the region.
struct Extent {
    float radius, own_radius;
    float taken_sq;  ///< no free point is left within the root of it
};

/// Grows regions over some of the blocks, looking at no others.
class Growth {
public:
    /// Adds the regions to `result`.
    Growth(PointBlocks& blocks, const RegionBounds& bounds, Places own, Regions& result)
        : blocks_(blocks),
          bounds_{std::min<std::uint64_t>(bounds.max_size, blocks.samples().size),
                  bounds.max_variation},
          own_(own),
          free_(own.begin),
          near_(own.begin, own.end),
          result_(result) {
        size_ = first_size();
    }

    /// How far apart points are about the next seed, more or less: R over the root of the size.
    void expect_spacing(float spacing) { spacing_ = spacing; }
    /// How far apart they are about this one.
    float spacing_at(Index seed) {
        const auto share = static_cast<float>(size_) / static_cast<float>(own_.size());
        float radius = 0.5F * blocks_.extent() * std::sqrt(share);
        while (look_about(seed, radius, radius, kNoLimit), near_.all_count < size_) radius *= 2;
        return radius_of_size(radius) / std::sqrt(static_cast<float>(size_));
    }

    /// Grows regions from that seed on until no free point is left that could be a seed. Points are
    /// left free where one would have to look at blocks that are not its own.
    void run(std::optional<Index> seed, const RunContext& context) {
        if (result_.regions.empty())  // all that there are going to be; room costs nothing
            reserve_in_blocks(result_.regions, 2 * own_.size() / size_, context);
        while (seed) {
            context.throw_if_stopped();
            constexpr std::size_t kBetweenReports = 64;  // regions
            const std::size_t regions = result_.regions.size();
            if (own_.size() == blocks_.samples().size && regions % kBetweenReports == 0) {
                context.checkpoint(static_cast<double>(result_.members.size()) / own_.size());
            }
            if (regions == result_.regions.capacity())
                reserve_in_blocks(result_.regions, 2 * regions + kBetweenReports, context);
            if (const std::optional<Grown> grown = grow(*seed)) {
                take(*seed, *grown);
                seed = next_seed(grown->extent);
            } else {
                blocks_.keep_block_from_seeding(*seed, own_.begin, own_.end);
                seed = first_free();
            }
        }
    }

    /// How many points a region has that grows from there.
    std::size_t size_from(Index seed) {
        size_ = first_size();
        spacing_ = spacing_at(seed);
        grow(seed);
        return chosen_.size();
    }

    /// The free point, of those that may be seeds, that comes first in the blocks.
    std::optional<Index> first_free() {
        while (free_ < own_.end && !blocks_.may_seed(free_)) ++free_;
        if (free_ == own_.end) return {};
        return free_;
    }

private:
    static constexpr std::size_t kNoLimit = std::numeric_limits<std::size_t>::max();
    struct Ordered {
        std::uint64_t key;  ///< squared distance, then number
        Index place;
    };
    /// A region, of the chosen points.
    struct Grown {
        Extent extent;
        double variation = 0;
        bool is_bent = false;
    };

    std::uint64_t first_size() const noexcept {
        return bounded() ? std::min(kFirstSize, bounds_.max_size) : bounds_.max_size;
    }
    bool bounded() const noexcept { return std::isfinite(bounds_.max_variation); }
    Vec3f position(Index place) const noexcept { return blocks_.samples().position(place); }

    bool look_about(Index seed, float counted, float radius, std::size_t limit) {
        return near_.look(blocks_, position(seed), counted, radius, limit);
    }

    /// R, where `counted` is no less.
    float radius_of_size(float counted) {
        return std::sqrt(mth_smallest(near_.all_sq, near_.all_count, counted * counted,
                                      near_.all_count, size_, buffer_));
    }

    /// Finds R of a region of `size_` points, and the free ones within `kLook` R; nothing where
    /// that takes looking at blocks that are not its own.
    std::optional<float> survey(Index seed) {
        const float typical = spacing_ * std::sqrt(static_cast<float>(size_));
        const float most = kMostGrowth * typical;
        float counted = kFirstCount * typical, looked = kFirstLook * typical;
        const std::size_t limit = kMostLooked * size_;
        constexpr float kNothing = std::numeric_limits<float>::min();  // nearer is at one place
        near_.is_beyond = false;
        while (!look_about(seed, counted, looked, limit) && !near_.is_beyond && looked > kNothing) {
            constexpr float kNearer = 0.6F;
            counted *= kNearer;
            looked *= kNearer;
        }
        for (const float farther : {looked, most}) {  // where R is more, or a crowd stands beyond
            if (near_.is_beyond || near_.all_count >= size_ || counted >= most) break;
            counted = farther;
            looked = std::max(looked, farther);
            look_about(seed, counted, looked, kNoLimit);
        }
        if (near_.is_beyond) return {};
        float radius = most;
        if (near_.all_count >= size_) radius = std::min(most, radius_of_size(counted));
        if (looked < kLook * radius) look_about(seed, radius, kLook * radius, kNoLimit);
        if (near_.is_beyond) return {};
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

    /// Chooses the points of the region about a seed; nothing where blocks that are not its own
    /// are in reach.
    std::optional<Grown> grow(Index seed) {
        while (true) {
            const std::optional<float> radius = survey(seed);
            if (!radius) return {};
            follow_density(*radius);
            const float taken_sq = collect(seed, kReach * *radius);
            if (!bounded()) return Grown{.extent = {*radius, *radius, taken_sq}};
            const std::size_t all = chosen_.size();
            const Grown grown = within_variation(seed, {*radius, *radius, taken_sq});
            const std::size_t kept = chosen_.size();
            if (!grown.is_bent && all == size_ && size_ < bounds_.max_size) {
                size_ = std::min(kGrowth * size_, bounds_.max_size);
                continue;
            }
            if (grown.is_bent) {
                size_ = std::clamp<std::uint64_t>(2 * kept, first_size(), bounds_.max_size);
            }
            return grown;
        }
    }

    /// Chooses the nearest free points within `reach`, `size_` at most, in any order. @return the
    /// squared distance up to which these are all.
    float collect(Index seed, float reach) {
        float limit = reach * reach;
        const std::size_t free =
            cluster_kernels().count(near_.free_sq.data(), near_.free_count, limit);
        if (free > size_)
            limit = mth_smallest(near_.free_sq, near_.free_count, limit, free, size_, buffer_);
        chosen_.resize(near_.free_count + PointBlocks::kSlack);
        chosen_.resize(cluster_kernels().places_between(near_.free_sq.data(), near_.free.data(),
                                                        near_.free_count, -1.0F, limit,
                                                        chosen_.data()));
        // In a crowd that is taken one did not look as far as to the seed itself.
        if (chosen_.empty()) chosen_.push_back(seed);
        if (chosen_.size() <= size_) return limit;
        sort_chosen(seed);  // among equal distances
        chosen_.resize(size_);
        return std::nextafter(limit, -1.0F);
    }

    /// Puts what was chosen in order of distance.
    void sort_chosen(Index seed) {
        order_.clear();
        for (const Index place : chosen_) {
            const std::uint64_t high = std::bit_cast<std::uint32_t>(distance_sq(seed, place));
            order_.push_back({high << 32U | blocks_.samples().index[place], place});
        }
        std::ranges::sort(order_, {}, &Ordered::key);
        std::ranges::transform(order_, chosen_.begin(), &Ordered::place);
    }

    float distance_sq(Index seed, Index place) const noexcept {
        const Vec3f d = position(place) - position(seed);
        return d.x() * d.x() + d.y() * d.y() + d.z() * d.z();
    }

    bool varies_too_much(const Scatter& scatter) const noexcept {
        return varies_more_than(bounds_.max_variation, scatter.central());
    }

    /// Leaves of the chosen points those within the bound on the variation: all, or where they
    /// vary more those in the rings up to the last at which the bound holds.
    Grown within_variation(Index seed, const Extent& extent) {
        offsets_.resize(chosen_.size());
        for (std::size_t i = 0; i < chosen_.size(); ++i)
            offsets_.set(i, position(chosen_[i]) - position(seed));
        if (const Scatter all = offsets_.scatter(); !varies_too_much(all)) {
            const bool is_full = chosen_.size() == bounds_.max_size;
            return {extent, is_full ? 0 : variation_of(all.central()), false};
        }
        const float farthest_sq = std::ranges::max(offsets_.distance_sq);
        const auto ring_of = [&](std::size_t i) {
            const double part =
                static_cast<double>(offsets_.distance_sq[i]) / static_cast<double>(farthest_sq);
            return std::min(kRings - 1, static_cast<std::size_t>(part * kRings));
        };
        const std::size_t rings = rings_within_variation(ring_of);
        std::size_t left = 0;
        float own_sq = 0;
        for (std::size_t i = 0; i < chosen_.size(); ++i) {
            if (ring_of(i) >= std::max<std::size_t>(1, rings)) continue;
            chosen_[left++] = chosen_[i];
            own_sq = std::max(own_sq, offsets_.distance_sq[i]);
        }
        chosen_.resize(left);
        if (rings == 0) {
            chosen_.resize(longest_within_variation(seed));
            own_sq = distance_sq(seed, chosen_.back());
        }
        return {{extent.radius, std::sqrt(own_sq), std::nextafter(own_sq, -1.0F)}, 0, true};
    }

    /// The most rings, but not all, that are within the bound on the variation.
    template <typename RingOf>
    std::size_t rings_within_variation(const RingOf& ring_of) const {
        std::array<Scatter, kRings> rings{};
        for (std::size_t i = 0; i < chosen_.size(); ++i) rings[ring_of(i)].add(offsets_[i]);
        Scatter scatter;
        std::size_t within = 0;
        for (std::size_t ring = 0; ring + 1 < kRings; ++ring) {
            scatter += rings[ring];
            if (scatter.count > 0 && !varies_too_much(scatter)) within = ring + 1;
        }
        return within;
    }

    /// The most of the nearest chosen points within the bound on the variation; sorts them.
    std::size_t longest_within_variation(Index seed) {
        sort_chosen(seed);
        Scatter scatter;
        std::size_t longest = 0;
        for (const Index place : chosen_) {
            scatter.add(position(place) - position(seed));
            if (!varies_too_much(scatter)) longest = scatter.count;
        }
        return longest;
    }

    /// Makes a region of the chosen points.
    void take(Index seed, const Grown& grown) {
        Region region{.variation = grown.variation, .is_bent = grown.is_bent};
        region.begin = static_cast<Index>(result_.members.size());
        region.end = region.begin + static_cast<Index>(chosen_.size());
        result_.members.resize(region.end);
        Vec3f offsets = Vec3f::Zero();
        const SampleSpan samples = blocks_.samples();
        const Vec3f center = position(seed);
        Index* member = &result_.members[region.begin];
        for (const Index place : chosen_) {
            blocks_.take(place);
            *member++ = samples.index[place];
            offsets += samples.position(place) - center;
        }
        region.centroid = center + offsets / static_cast<float>(chosen_.size());
        result_.regions.push_back(region);
    }

    std::optional<Index> next_seed(const Extent& extent) {
        const float limit = (kLook * extent.radius) * (kLook * extent.radius);
        const float wanted = (kNextSeed * extent.own_radius) * (kNextSeed * extent.own_radius);
        std::pair<float, Index> best = {std::numeric_limits<float>::infinity(), 0};
        Index best_place = 0;
        for (std::size_t i = 0; i < near_.free_count; i += 4) {
            const Float4 d = load(&near_.free_sq[i]), miss = d < wanted ? wanted - d : d - wanted;
            unsigned lanes = lane_bits((d > extent.taken_sq) & (d <= limit) & (miss <= best.first));
            for (; lanes != 0; lanes &= lanes - 1) {
                const auto lane = static_cast<std::size_t>(std::countr_zero(lanes));
                const Index place = near_.free[i + lane];
                if (!blocks_.may_seed(place)) continue;
                const std::pair candidate = {miss[lane], blocks_.samples().index[place]};
                if (candidate < best) {
                    best = candidate;
                    best_place = place;
                }
            }
        }
        if (std::isfinite(best.first)) return best_place;
        return first_free();
    }

    PointBlocks& blocks_;
    RegionBounds bounds_;
    Places own_;
    Index free_;          ///< before it no place is free, or may be a seed
    std::uint64_t size_;  ///< n_max, or what is tried under a bound on the variation
    float spacing_ = 0;   ///< typical R over the root of the size
    Surroundings near_;
    std::vector<Index> chosen_;  ///< their places
    Offsets offsets_;
    std::vector<Ordered> order_;
    std::vector<float> buffer_;
    Regions& result_;
};

/// Parts of the blocks that threads can grow regions in, so large that little is left between them.
std::vector<Places> parts_of(std::size_t points, std::uint64_t max_size) {
    constexpr std::size_t kRegions = 2048, kMostParts = 16;
    const std::size_t parts =
        std::min(kMostParts, points / std::min<std::uint64_t>(max_size, points) / kRegions);
    std::vector<Places> all;
    for (std::size_t i = 0; parts > 1 && i < parts; ++i) {
        all.push_back({static_cast<Index>(i * points / parts),
                       static_cast<Index>((i + 1) * points / parts - PointBlocks::kSlack)});
    }
    return all;
}

void append(Regions& to, const Regions& more, const RunContext& context) {
    const auto offset = static_cast<Index>(to.members.size());
    for_blocks_in_order(more.members.size(), context, [&](std::size_t begin, std::size_t end) {
        to.members.insert(to.members.end(),
                          more.members.begin() + static_cast<std::ptrdiff_t>(begin),
                          more.members.begin() + static_cast<std::ptrdiff_t>(end));
    });
    for (Region region : more.regions) {
        region.begin += offset;
        region.end += offset;
        to.regions.push_back(region);
    }
}

}  // namespace

PointBlocks blocks_for_regions(std::span<const Vec3f> points, const RegionBounds& bounds,
                               const RunContext& context) {
    // What takes the fewest instructions over the scans tried.
    const std::uint64_t size = std::min<std::uint64_t>(bounds.max_size, points.size());
    return PointBlocks(points, std::clamp<std::uint64_t>(3 * size / 2, 32, 512), {}, context);
}

double estimated_regions(PointBlocks& blocks, const RegionBounds& bounds,
                         const RunContext& context) {
    constexpr std::size_t kTried = 64;
    const auto n = static_cast<Index>(blocks.samples().size);
    Regions none;
    Growth growth(blocks, bounds, {0, n}, none);
    double sum = 0;
    for (std::size_t i = 0; i < kTried; ++i) {
        context.throw_if_stopped();
        const auto seed = static_cast<Index>(below(random_bits(1, i), n));
        sum += 1.0 / static_cast<double>(growth.size_from(seed));
    }
    return sum / kTried * n;
}

Regions grow_regions(PointBlocks& blocks, const RegionBounds& bounds, std::uint64_t seed,
                     const RunContext& context) {
    const auto n = static_cast<Index>(blocks.samples().size);
    Regions result;
    result.scale = blocks.scale();
    reserve_in_blocks(result.members, n, context);
    Growth whole(blocks, bounds, {0, n}, result);
    std::optional first = static_cast<Index>(below(random_bits(seed, 0), n));
    const float spacing = whole.spacing_at(*first);
    whole.expect_spacing(spacing);

    const std::vector<Places> parts = parts_of(n, bounds.max_size);
    if (!parts.empty()) {
        std::vector<Regions> grown(parts.size());
        parallel_for_blocks(parts.size(), 1, context, [&](std::size_t i, std::size_t) {
            reserve_in_blocks(grown[i].members, parts[i].size(), context);
            Growth growth(blocks, bounds, parts[i], grown[i]);
            growth.expect_spacing(spacing);
            const auto at = static_cast<Index>(below(random_bits(seed, i), parts[i].size()));
            growth.run(parts[i].begin + at, context);
        });
        std::size_t count = 0;
        for (const Regions& part : grown) count += part.regions.size();
        reserve_in_blocks(result.regions, count + count / 8, context);
        for (const Regions& part : grown) append(result, part, context);
        blocks.let_all_seed(context);
        first = whole.first_free();
    }
    whole.run(first, context);
    return result;
}

}  // namespace stipple
