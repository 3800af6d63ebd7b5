#include "stipple/particle_simulation.hpp"

#include "analysis/tangent_plane.hpp"
#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "base/refuse.hpp"
#include "base/until_stopped.hpp"
#include "cloud/cloud_copy.hpp"
#include "cloud/hilbert_order.hpp"
#include "clustering/representatives.hpp"
#include "particles/particle_density.hpp"
#include "particles/particle_relaxation.hpp"
#include "particles/particle_simulator.hpp"
#include "particles/particle_spread.hpp"
#include "particles/particle_surface.hpp"
#include "particles/surface_samples.hpp"
#include "stipple/mls.hpp"
#include "stipple/neighbors.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <numbers>
#include <numeric>
#include <optional>
#include <set>
#include <utility>

// Follows: Pauly, Gross, Kobbelt 2002, §3.3. Departures:
// - Coarse to fine (§5.1) serves upsampling only; core/README.md says why. Particles at rest, once
//   they are more than the samples, take their place as the surface of the next stage.
// - Repulsion ends with steps of a radius below the spacing. Equilibrium at a larger one leaves
//   pairs that their surroundings press together, at 0.7 of the mean distance and less.
// - Such steps follow the projection too, on the moving least squares surface itself.
// - Denser where sigma_n is high: the paper's text replaces rho by rho sigma_n in the spreading,
//   which would be thinner there; shares of particles are 1 / (rho r^2), with r the radius.

namespace stipple {

namespace {

constexpr std::size_t kSamplesPerParticle = 16;
constexpr std::size_t kBlock = 1'024;

// Radii over the spacing. With the first, each particle feels the ring around it and the whole
// comes to rest; it is evenly spread then, but for pairs that the others press together. With the
// second, only pairs that are too close feel each other, and part; with the third, only those that
// the projection brought together.
constexpr float kSpreadRadius = 1.25F;
constexpr float kPartRadius = 0.88F;
constexpr float kSettledRadius = 0.85F;
constexpr unsigned kRounds = 2;    // after the first, some start anew
constexpr double kNearly = 0.2;    // of the tolerance, where pairs are pressed by others
constexpr double kSlowing = 0.97;  // of the step before, while they come to rest
constexpr double kSlow = 4;        // of the tolerance; longer steps never count as rest

void check_count(std::uint64_t particles) {
    constexpr auto kMost = std::numeric_limits<Index>::max();
    if (particles == 0 || particles > kMost)
        refuse("target_size ", particles, ": expected 1..", kMost);
}

void check(const ParticleSimulationOptions& options, const PointCloud& cloud) {
    require_cleaned(cloud);
    if (cloud.empty()) refuse("the cloud has no points: expected at least 1");
    check_ranges(options);
    check_attributes(options.regions, cloud);
}

/// How many points stand for the surface: all of them, or, for a uniform simplification, as many as
/// particles can tell apart. In place of nearly all it is all, which another run may have left.
std::size_t sample_count(std::size_t points, std::size_t particles,
                         const ParticleSimulationOptions& options) {
    const bool uniform = options.adaptivity == 0 && options.regions.empty();
    const std::size_t told_apart = kSamplesPerParticle * particles;
    return uniform && told_apart < points - points / 8 ? told_apart : points;
}

/// Which points of an order along a curve have their neighbours on it much farther than most: where
/// the cloud is sparse.
std::vector<std::uint8_t> sparse_ones(const PointCloud& cloud, std::span<const Index> order,
                                      const RunContext& context) {
    constexpr std::size_t kBeside = 4, kAsked = 4'096;
    constexpr float kMuchFarther = 5;  // than the median: in an even cloud hardly one of a billion
    const auto nearest_beside = [&](std::size_t i) {
        const Vec3f& p = cloud.positions[order[i]];
        float least = std::numeric_limits<float>::infinity();
        for (std::size_t j = i - std::min(i, kBeside); j < std::min(order.size(), i + kBeside + 1);
             ++j)
            if (j != i) least = std::min(least, (cloud.positions[order[j]] - p).squaredNorm());
        return least;
    };
    std::vector<float> asked;
    for (std::size_t i = 0; i < order.size(); i += 1 + order.size() / kAsked)
        asked.push_back(nearest_beside(i));
    const auto middle = asked.begin() + static_cast<std::ptrdiff_t>(asked.size() / 2);
    std::ranges::nth_element(asked, middle);
    const float much = kMuchFarther * kMuchFarther * *middle;
    auto sparse = made_in_blocks<std::vector<std::uint8_t>>(order.size(), context);
    parallel_for_blocks(order.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) sparse[i] = nearest_beside(i) > much ? 1 : 0;
    });
    return sparse;
}

/// Every so many-th, that `count` are left; but where the cloud is sparse all, up to as many again:
/// there a few stand for much of the surface.
std::vector<Index> thinned(const PointCloud& cloud, std::span<const Index> order, std::size_t count,
                           const RunContext& context) {
    const std::size_t n = order.size();
    const std::vector<std::uint8_t> sparse = sparse_ones(cloud, order, context);
    const auto all = static_cast<std::size_t>(std::ranges::count(sparse, 1));
    std::vector<Index> chosen;
    chosen.reserve(count + std::min(all, count));
    std::size_t taken = 0, seen = 0;  // of the even ones, of the sparse ones
    for_blocks_in_order(n, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const bool is_next = taken < count && i == (2 * taken + 1) * n / (2 * count);
            taken += is_next ? 1 : 0;
            bool is_kept = false;
            if (sparse[i] != 0) {
                is_kept = all <= count || seen * count / all != (seen + 1) * count / all;
                ++seen;
            }
            if (is_next || is_kept) chosen.push_back(order[i]);
        }
    });
    return chosen;
}

/// The spacing of particles at each sample, up to a common factor.
std::vector<float> relative_spacing(const PointCloud& cloud, const SurfaceSamples& samples,
                                    std::span<const float> areas,
                                    const ParticleSimulationOptions& options,
                                    const RunContext& context) {
    std::vector<float> spacing(samples.points.size(), 1.0F);
    if (options.adaptivity > 0) {
        spacing =
            adaptive_spacing(samples, areas, options.adaptivity, options.max_grading, context);
    }
    if (options.regions.empty()) return spacing;
    parallel_for_blocks(spacing.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i)
            spacing[i] *= region_spacing(options.regions, cloud, samples.points[i]);
    });
    return spacing;
}

/// Spacing that particles can have which are shared out so: in a hexagonal lattice, each has
/// sqrt(3) / 2 of its square. Where shares are bounded, as of stray points, whose areas are beyond
/// measure, that is not so, and they do not count. The factor is found anew while they relax.
void scale_spacing(std::vector<float>& spacing, std::span<const float> areas,
                   std::span<const float> shares, const RunContext& context) {
    float most = 0;  // particles for an area of spacing 1
    for_blocks_in_order(spacing.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i)
            most = std::max(most, shares[i] * spacing[i] * spacing[i] / areas[i]);
    });
    const auto factor =
        static_cast<float>(std::sqrt(2 / std::numbers::sqrt3 / static_cast<double>(most)));
    for_blocks_in_order(spacing.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) spacing[i] *= factor;
    });
}

/// Steps until `is_done` with one, at most so many.
template <typename Step, typename IsDone>
void repeat(unsigned most, Step&& step, IsDone&& is_done, const RunContext& context) {
    for (unsigned i = 0; i < most; ++i) {
        if (is_done(step())) break;
        context.checkpoint(static_cast<double>(i + 1) / most);
    }
    context.checkpoint(1.0);
}

/// Repulsion (§3.3) until the particles are at rest, or come no nearer to it.
void come_to_rest(ParticleRelaxation& particles, const ParticleSimulationOptions& options,
                  const RunContext& context) {
    double last_step = std::numeric_limits<double>::infinity();
    const auto at_rest = [&](const ParticleRelaxation::Progress& p) {
        const bool slows_down = p.mean_step < kSlowing * std::exchange(last_step, p.mean_step);
        return p.mean_step < options.tolerance ||
               (p.mean_step < kSlow * options.tolerance && !slows_down);
    };
    repeat(
        options.max_iterations, [&] { return particles.step(kSpreadRadius, true); }, at_rest,
        context);
}

/// Repulsion of those that are too close, until none are or only those that others press together;
/// which has to be done again where the projection onto the surface moved some. What is crowded
/// still has no way to go, and starts anew elsewhere.
void part(ParticleRelaxation& particles, const ParticleSimulationOptions& options,
          const RunContext& context) {
    using Progress = ParticleRelaxation::Progress;
    const auto apart = [](const Progress& p) { return p.knows_all && p.crowded == 0; };
    const auto nearly_apart = [&](const Progress& p) {
        return apart(p) || p.mean_step < kNearly * options.tolerance;
    };
    repeat(
        options.max_iterations, [&] { return particles.step(kPartRadius, false); }, nearly_apart,
        context.part(0.0, 0.5));
    particles.settle();
    const auto settled_step = [&] { return particles.step(kSettledRadius, false); };
    for (unsigned round = 0; round < kRounds; ++round) {
        const RunContext rest =
            context.part(0.5 + 0.5 * round / kRounds, 0.5 + 0.5 * (round + 1) / kRounds);
        repeat((options.max_iterations + 3) / 4, settled_step, apart, rest);
        if (round + 1 == kRounds || !particles.relocate(kSettledRadius)) break;
    }
    context.checkpoint(1.0);
}

/// How many particles there are in each stage, the last first. Where there are more of them than
/// samples, they come to rest soonest as a quarter of them, which is split (§5.1): the lattice of
/// those at rest has room for three times as many. Any fewer would miss small parts of the surface,
/// that none can cross over to.
std::vector<std::size_t> stages(std::size_t count, std::size_t samples) {
    constexpr std::size_t kFewest = 4'096;
    constexpr double kSplit = 3.9;
    std::vector<std::size_t> counts = {count};
    while (counts.back() > std::max(samples, kFewest))
        counts.push_back(static_cast<std::size_t>(static_cast<double>(counts.back()) / kSplit));
    return counts;
}

/// What particles move on, and how far apart they should be there, up to a common factor.
struct Ground {
    SurfaceSamples samples;
    std::vector<std::uint8_t> rough;
    std::vector<float> areas, spacing;
    ParticleSurface surface;

    Ground(SurfaceSamples samples_, std::vector<float> areas_, std::vector<float> spacing_,
           const MlsSurface& mls, const ParticleFrame& frame, const RunContext& context)
        : samples(std::move(samples_)),
          rough(rough_samples(samples, context)),
          areas(std::move(areas_)),
          spacing(std::move(spacing_)),
          surface(samples, mls, frame, context) {}
    Ground(const Ground&) = delete;
    Ground& operator=(const Ground&) = delete;

    std::vector<float> shares_of(std::size_t count, const RunContext& context) const {
        return particle_shares(areas, spacing, rough, count, context);
    }
    std::vector<float> scaled_spacing(std::span<const float> shares,
                                      const RunContext& context) const {
        std::vector<float> scaled = spacing;
        scale_spacing(scaled, areas, shares, context);
        return scaled;
    }
};

/// The ground of the points, and later of particles in their place.
class Simulation {
public:
    Simulation(std::shared_ptr<const Ground> ground, const MlsSurface& mls,
               const ParticleFrame& frame, const ParticleSimulationOptions& options,
               const RunContext& context)
        : mls_(mls),
          frame_(frame),
          options_(options),
          context_(context.quietly()),
          ground_(std::move(ground)) {}

    /// As many particles as are wanted, at rest on tangent planes.
    ParticleRelaxation& spread_evenly(const RunContext& context) {
        const auto count = static_cast<std::size_t>(options_.target_size);
        std::vector<std::size_t> counts = stages(count, ground_->samples.size());
        double done = counts.size() == 1 ? 1.0 : 0.5;
        spread(counts.back());
        come_to_rest(*particles_, options_, context.part(0.0, done));
        for (counts.pop_back(); !counts.empty(); counts.pop_back()) {
            while (particles_->positions().size() < counts.back()) {
                const RunContext next = context.part(done, 0.5 * (done + 1.0));
                done = 0.5 * (done + 1.0);
                if (!split(counts.back())) {  // the points lie on no surface
                    spread(count);
                    come_to_rest(*particles_, options_, next);
                    return *particles_;
                }
                come_to_rest(*particles_, options_, next);
            }
        }
        return *particles_;
    }

private:
    void spread(std::size_t count) {
        const std::vector<float> shares = ground_->shares_of(count, context_);
        particles_.emplace(
            ground_->surface, ground_->scaled_spacing(shares, context_),
            spread_particles(ground_->samples, shares, count, options_.seed, context_), context_);
    }

    /// Splits the particles, which stand for the surface from then on where they are more than what
    /// did before: its tangent planes would be too large for so many.
    bool split(std::size_t most) {
        const bool are_finer = particles_->positions().size() > ground_->samples.size();
        if (!are_finer) return particles_->split(most);
        particles_->settle();
        std::shared_ptr<const Ground> finer = ground_of_particles();
        if (!particles_->split(most)) return false;
        SpreadParticles start;
        const std::span<const Vec3f> positions = particles_->positions();
        resize_in_blocks(start.positions, positions.size(), context_);
        resize_in_blocks(start.samples, positions.size(), context_);
        parallel_for_blocks(positions.size(), kBlock, context_,
                            [&](std::size_t begin, std::size_t end) {
                                for (std::size_t i = begin; i < end; ++i) {
                                    start.positions[i] = positions[i];
                                    start.samples[i] = finer->surface.nearest(positions[i]);
                                }
                            });
        const std::vector<float> shares = finer->shares_of(start.positions.size(), context_);
        particles_.emplace(finer->surface, finer->scaled_spacing(shares, context_),
                           std::move(start), context_);
        ground_ = std::move(finer);
        return true;
    }

    std::shared_ptr<const Ground> ground_of_particles() const {
        const std::span<const Vec3f> positions = particles_->positions();
        PointCloud cloud;
        resize_in_blocks(cloud.positions, positions.size(), context_);
        auto numbers = made_in_blocks<std::vector<Index>>(positions.size(), context_);
        auto spacing = made_in_blocks<std::vector<float>>(positions.size(), context_);
        for_blocks_in_order(positions.size(), context_, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) {
                cloud.positions[i] = frame_.outside(positions[i]).cast<float>();
                spacing[i] = particles_->spacing(i);
                numbers[i] = static_cast<Index>(i);
            }
        });
        SurfaceSamples samples = sample_surface(cloud, std::move(numbers), frame_, context_);
        std::vector<float> areas = sample_areas(samples, context_);
        return std::make_shared<const Ground>(std::move(samples), std::move(areas),
                                              std::move(spacing), mls_, frame_, context_);
    }

    const MlsSurface& mls_;
    ParticleFrame frame_;
    const ParticleSimulationOptions& options_;
    RunContext context_;
    std::shared_ptr<const Ground> ground_;
    std::optional<ParticleRelaxation> particles_;
};

/// The cloud's points at and around each particle, whose attributes it gets.
struct Sources {
    std::vector<Index> members, offsets, nearest;
};

/// Of the points nearest to a place those that lie on the side of a thin wall on which the nearest
/// of all does: across from it they lie above or below its tangent plane rather than beside it, and
/// their normals look the other way; where those of nearly all beside it do, its own is the wrong
/// one. In the same order.
std::span<Neighbor> on_one_side(std::span<Neighbor> found, const PointCloud& cloud) {
    constexpr std::size_t kForPlane = 6;
    constexpr float kBeside = 0.7F;  // the sine of the steepest way
    std::array<Vec3d, kForPlane> offsets;
    const Index nearest = found.front().index;
    const Vec3f& from = cloud.positions[nearest];
    const std::size_t count = std::min(found.size(), kForPlane);
    for (std::size_t i = 1; i < count; ++i)
        offsets[i - 1] = (cloud.positions[found[i].index] - from).cast<double>();
    if (count < 4) return found;
    const Vec3f normal = normal_from(std::span(offsets).first(count - 1)).cast<float>();
    const auto is_steep = [&](const Neighbor& neighbor) {
        const Vec3f way = cloud.positions[neighbor.index] - from;
        return std::abs(normal.dot(way)) > kBeside * way.norm();
    };
    const auto looks_away = [&](const Neighbor& neighbor) {
        return !cloud.normals.empty() &&
               cloud.normals[neighbor.index].dot(cloud.normals[nearest]) < 0;
    };
    std::size_t beside = 0, away = 0;
    for (const Neighbor& neighbor : found.subspan(1)) {
        if (is_steep(neighbor)) continue;
        ++beside;
        away += looks_away(neighbor) ? 1 : 0;
    }
    constexpr std::size_t kEnough = 5;
    const bool is_wrong = beside >= kEnough && 8 * away >= 7 * beside;
    const auto is_across = [&](const Neighbor& neighbor) {
        return is_steep(neighbor) || looks_away(neighbor) != is_wrong;
    };
    const auto others = std::ranges::stable_partition(
        found, [&](const Neighbor& neighbor) { return !is_across(neighbor); });
    return found.first(found.size() - others.size());
}

/// With fewer particles than points, as many of the nearest points as there are to a particle, at
/// most; else the four nearest, the nearer the more often: each by Franke and Little's weight,
/// which is large at a point and 0 at the next farther one, so that values change smoothly.
Sources find_sources(const NeighborSearch& search, const PointCloud& cloud,
                     const std::vector<Vec3f>& positions, const RunContext& context) {
    constexpr std::size_t kInterpolated = 4, kAveraged = 16;
    constexpr float kTimes = 8;
    constexpr auto kListed = kInterpolated * static_cast<std::size_t>(kTimes);
    constexpr std::size_t kMost = std::numeric_limits<Index>::max() / kListed;
    if (positions.size() > kMost)
        refuse("target_size ", positions.size(), ": expected at most ", kMost,
               " for a cloud with attributes");
    const std::size_t share = cloud.size() / positions.size();
    const bool interpolate = share < kInterpolated;
    const std::size_t wanted = interpolate ? kInterpolated + 1 : std::min(share, kAveraged);
    Sources sources;
    resize_in_blocks(sources.nearest, positions.size(), context);
    resize_in_blocks(sources.offsets, positions.size() + 1, context);
    std::vector<std::vector<Index>> blocks((positions.size() + kBlock - 1) / kBlock);
    parallel_for_blocks(positions.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        std::array<Neighbor, kAveraged> room;
        std::vector<Index>& members = blocks[begin / kBlock];
        for (std::size_t i = begin; i < end; ++i) {
            std::span<Neighbor> found = search.nearest(positions[i], std::span(room).first(wanted));
            if (!interpolate) found = on_one_side(found, cloud);
            const float limit = std::sqrt(found.back().distance_sq);
            const auto weight = [limit](const Neighbor& n) {
                const float d = std::max(std::sqrt(n.distance_sq), 1e-3F * limit);
                return (limit - d) * (limit - d) / (d * d);
            };
            const float heaviest = limit > 0 ? weight(found.front()) : 0;
            const std::size_t before = members.size();
            for (const Neighbor& n : found) {
                const auto times = !interpolate || !(heaviest > 0)
                                       ? 1
                                       : std::lround(kTimes * weight(n) / heaviest);
                members.insert(members.end(), static_cast<std::size_t>(times), n.index);
            }
            sources.nearest[i] = found.front().index;
            sources.offsets[i + 1] = static_cast<Index>(members.size() - before);
        }
    });
    for_blocks_in_order(positions.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) sources.offsets[i + 1] += sources.offsets[i];
    });
    sources.members.reserve(sources.offsets.back());
    for (const std::vector<Index>& block : blocks) {
        context.throw_if_stopped();
        sources.members.insert(sources.members.end(), block.begin(), block.end());
    }
    return sources;
}

/// Puts particles that are where one before them is, as rounding to floats may leave them, at
/// points of the cloud at which none is: the nearest, as far as they are free.
void part_equal(std::vector<Vec3f>& positions, std::span<const Vec3f> points,
                const std::function<const NeighborSearch&()>& search, const RunContext& context) {
    constexpr std::size_t kAsked = 32;
    const auto comes_before = [](const Vec3f& a, const Vec3f& b) {
        return std::ranges::lexicographical_compare(a, b);
    };
    std::vector<Index> order(positions.size());
    std::iota(order.begin(), order.end(), Index{0});
    std::ranges::sort(order, until_stopped(context, [&](Index a, Index b) {
                          if (positions[a] == positions[b]) return a < b;
                          return comes_before(positions[a], positions[b]);
                      }));
    std::vector<Index> repeated;
    for (std::size_t i = 1; i < order.size(); ++i)
        if (positions[order[i]] == positions[order[i - 1]]) repeated.push_back(order[i]);
    if (repeated.empty()) return;
    std::ranges::sort(repeated);
    std::set<Vec3f, decltype(comes_before)> taken(positions.begin(), positions.end(), comes_before);
    std::array<Neighbor, kAsked> room;
    std::size_t next = 0;  // of the cloud, where all that are near are taken
    for (const Index i : repeated) {
        const auto take = [&](const Vec3f& point) {
            const bool is_free = taken.insert(point).second;
            if (is_free) positions[i] = point;
            return is_free;
        };
        const std::span<const Neighbor> near = search().nearest(positions[i], room);
        if (std::ranges::any_of(near, [&](const Neighbor& n) { return take(points[n.index]); }))
            continue;
        while (next < points.size() && !take(points[next])) ++next;
    }
}

}  // namespace

void check_ranges(const ParticleSimulationOptions& options) {
    require(options.adaptivity >= 0 && options.adaptivity <= 1, "adaptivity", options.adaptivity,
            "0 to 1");
    require(options.max_grading >= 1 && std::isfinite(options.max_grading), "max_grading",
            options.max_grading, "a finite number, at least 1");
    check_ranges(options.regions);
    require(options.max_iterations >= 1, "max_iterations", options.max_iterations, "at least 1");
    require(options.tolerance > 0 && options.tolerance < 1, "tolerance", options.tolerance,
            "above 0, below 1");
}

struct ParticleSimulator::Implementation {
    const PointCloud& cloud;
    ParticleSimulationOptions options;
    Reductions reductions;
    ParticleFrame frame;
    // Of points that do not all coincide.
    std::vector<Index> order;  ///< along a space-filling curve
    std::optional<MlsSurface> mls;
    std::shared_ptr<const Ground> ground;  ///< of the last run
    std::size_t ground_wanted = 0;         ///< how many points it was to have
    std::optional<NeighborSearch> search;  ///< once attributes were taken from points nearby

    Implementation(const PointCloud& cloud_, const ParticleSimulationOptions& options_,
                   const RunContext& context)
        : cloud(cloud_),
          options(options_),
          reductions(reductions_for(cloud, options.reductions, Representative::Centroid)),
          frame(cloud.positions) {
        if (frame.scale == 0) return;
        order = hilbert_order(cloud.positions, context);
        mls.emplace(cloud.positions, MlsOptions{}, context);
    }

    /// For so many particles.
    const std::shared_ptr<const Ground>& ground_for(std::size_t count, const RunContext& context) {
        const std::size_t wanted = sample_count(cloud.size(), count, options);
        if (ground != nullptr && ground_wanted == wanted) return ground;
        ground = nullptr;
        ground_wanted = wanted;
        SurfaceSamples samples = sample_surface(
            cloud, wanted == order.size() ? order : thinned(cloud, order, wanted, context), frame,
            context);
        context.checkpoint(0.6);
        std::vector<float> areas = sample_areas(samples, context);
        std::vector<float> spacing = relative_spacing(cloud, samples, areas, options, context);
        context.checkpoint(0.8);
        ground = std::make_shared<const Ground>(std::move(samples), std::move(areas),
                                                std::move(spacing), *mls, frame, context);
        return ground;
    }

    /// Where the attributes of particles are from; nothing where there are none.
    Sources sources_of(const std::vector<Vec3f>& positions, const RunContext& context) {
        if (cloud.normals.empty() && cloud.colors.empty() && cloud.attributes.empty()) return {};
        return find_sources(search_in(context), cloud, positions, context);
    }

    const NeighborSearch& search_in(const RunContext& context) {
        if (!search) search.emplace(cloud.positions, context);
        return *search;
    }
};

ParticleSimulator::ParticleSimulator(const PointCloud& cloud,
                                     const ParticleSimulationOptions& options,
                                     const RunContext& context) {
    check(options, cloud);
    implementation_ = std::make_unique<Implementation>(cloud, options, context);
}

ParticleSimulator::~ParticleSimulator() = default;

PointCloud ParticleSimulator::run(std::uint64_t particles, const RunContext& context) {
    check_count(particles);
    Implementation& of = *implementation_;
    const auto count = static_cast<std::size_t>(particles);
    context.checkpoint(0.0);
    if (of.frame.scale == 0) return subset(of.cloud, std::vector<Index>(count, 0), context);

    ParticleSimulationOptions options = of.options;
    options.target_size = particles;
    Simulation simulation(of.ground_for(count, context.part(0.0, 0.2)), *of.mls, of.frame, options,
                          context);
    context.checkpoint(0.2);
    ParticleRelaxation& relaxed = simulation.spread_evenly(context.part(0.2, 0.65));
    part(relaxed, options, context.part(0.65, 0.95));
    std::vector<Vec3f> positions;
    positions.reserve(count);
    for_blocks_in_order(count, context, [&](std::size_t begin, std::size_t end) {
        for (const Vec3f& p : relaxed.positions().subspan(begin, end - begin))
            positions.push_back(of.frame.outside(p).cast<float>());
    });
    part_equal(
        positions, of.cloud.positions, [&]() -> const auto& { return of.search_in(context); },
        context);
    const Sources sources = of.sources_of(positions, context);
    PointCloud result =
        merged_cloud(of.cloud, std::move(positions), {sources.members.data(), sources.offsets},
                     sources.nearest, of.reductions, context);
    context.checkpoint(1.0);
    return result;
}

PointCloud particle_simulation(const PointCloud& cloud, const ParticleSimulationOptions& options,
                               const RunContext& context) {
    constexpr double kShared = 0.1;
    check_count(options.target_size);
    context.checkpoint(0.0);
    ParticleSimulator simulator(cloud, options, context.part(0.0, kShared));
    return simulator.run(options.target_size, context.part(kShared, 1.0));
}

}  // namespace stipple
