#include "particle_relaxation.hpp"

#include "parallel_for.hpp"
#include "particle_grid.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

namespace stipple {

namespace {

constexpr std::size_t kBlock = 512;
constexpr float kForce = 0.35F;       // k of Eq. 7: a step over the sum of overlaps
constexpr float kMomentum = 0.6F;     // part of a step that the next one keeps
constexpr float kLongestStep = 0.5F;  // over the spacing
constexpr float kResting = 1e-4F;     // shorter steps, over the spacing, are not taken
constexpr double kStrangers = 0.1;    // part of the particles that may lack new neighbours,
constexpr unsigned kOldest = 6;       // and for so many steps
constexpr std::size_t kRing = 6;      // neighbours of a particle on a surface

}  // namespace

ParticleRelaxation::ParticleRelaxation(const ParticleSurface& surface, std::vector<float> spacing,
                                       SpreadParticles start, const RunContext& context)
    : surface_(surface),
      context_{context.stop, {}, context.threads},
      spacing_(std::move(spacing)),
      positions_(std::move(start.positions)),
      next_(positions_.size()),
      steps_(positions_.size(), Vec3f::Zero()),
      relative_(positions_.size()),
      neighborhoods_((positions_.size() + kBlock - 1) / kBlock),
      progress_(neighborhoods_.size()) {
    feet_.reserve(positions_.size());
    for (const Index sample : start.samples) feet_.push_back({sample, 0});
    look_up_spacing();
}

ParticleRelaxation::Progress ParticleRelaxation::step(float radius, bool find_spacing) {
    const bool many =
        static_cast<double>(strangers_) > kStrangers * static_cast<double>(positions_.size());
    if (found_at_.empty() || many || (strangers_ > 0 && age_ >= kOldest)) {
        age_ = 0;
        find_neighbors();
        if (find_spacing) {
            double sum = 0;
            for (std::size_t block = 0; block < neighborhoods_.size(); ++block)
                sum += mean_of_six(block);
            factor_ *= static_cast<float>(sum / static_cast<double>(positions_.size()));
        }
    }
    ++age_;
    parallel_for_blocks(positions_.size(), kBlock, context_,
                        [&](std::size_t begin, std::size_t end) {
                            progress_[begin / kBlock] = move(begin, end, radius);
                        });
    std::swap(positions_, next_);
    look_up_spacing();
    Progress result;
    strangers_ = 0;
    for (const BlockProgress& block : progress_) {
        result.mean_step += block.step_sum / static_cast<double>(positions_.size());
        result.largest_overlap =
            std::max(result.largest_overlap, static_cast<double>(block.overlap));
        strangers_ += block.strangers;
    }
    result.knows_all = strangers_ == 0;
    return result;
}

void ParticleRelaxation::look_up_spacing() {
    for (std::size_t i = 0; i < relative_.size(); ++i) relative_[i] = spacing_[feet_[i].sample];
}

void ParticleRelaxation::settle() {
    settled_ = true;
    parallel_for_blocks(
        positions_.size(), kBlock, context_, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) {
                positions_[i] = surface_.settle(positions_[i], feet_[i], spacing(i));
                steps_[i].setZero();
            }
        });
    found_at_.clear();
}

void ParticleRelaxation::find_neighbors() {
    found_at_ = positions_;
    std::vector<float> reach(positions_.size());
    for (std::size_t i = 0; i < reach.size(); ++i) reach[i] = kReach * spacing(i);
    const ParticleGrid grid(positions_, reach, context_);
    parallel_for_blocks(positions_.size(), kBlock, context_,
                        [&](std::size_t begin, std::size_t end) {
                            Neighborhood& near = neighborhoods_[begin / kBlock];
                            near.members.clear();
                            near.ends.clear();
                            for (std::size_t i = begin; i < end; ++i) {
                                grid.append_neighbors(static_cast<Index>(i), near.members);
                                near.ends.push_back(static_cast<Index>(near.members.size()));
                            }
                        });
}

/// The sum over a block of the mean distance, over the spacing, to the six nearest; those that are
/// out of reach count as if they were just there.
double ParticleRelaxation::mean_of_six(std::size_t block) const {
    double sum = 0;
    for (std::size_t local = 0; local < neighborhoods_[block].ends.size(); ++local) {
        const std::size_t i = block * kBlock + local;
        std::array<float, kRing> nearest;
        nearest.fill(kReach);
        for (const Index j : neighborhoods_[block].of(local)) {
            float distance = 2 * (positions_[j] - positions_[i]).norm() / (spacing(i) + spacing(j));
            for (float& place : nearest)
                if (distance < place) std::swap(distance, place);
        }
        for (const float distance : nearest) sum += static_cast<double>(distance) / kRing;
    }
    return sum;
}

ParticleRelaxation::BlockProgress ParticleRelaxation::move(std::size_t begin, std::size_t end,
                                                           float radius) {
    const Neighborhood& near = neighborhoods_[begin / kBlock];
    BlockProgress progress;
    for (std::size_t i = begin; i < end; ++i) {
        const Vec3f p = positions_[i];
        const float own = spacing(i);
        const Vec3f normal = surface_.normal(feet_[i].sample);
        Vec3f force = Vec3f::Zero();  // Eq. 8
        for (const Index j : near.of(i - begin)) {
            const float r = radius * 0.5F * (own + spacing(j));
            const Vec3f f = repulsion(p, positions_[j], r);
            const float length_sq = f.squaredNorm();
            if (length_sq == 0) continue;
            progress.overlap = std::max(progress.overlap, length_sq / (r * r));
            const Vec3f along = f - normal * normal.dot(f);
            const float along_sq = along.squaredNorm();
            force +=
                along_sq > 1e-6F * length_sq ? Vec3f(along * std::sqrt(length_sq / along_sq)) : f;
        }
        Vec3f step = kMomentum * steps_[i] + kForce * force;
        const float length = step.norm();
        next_[i] = p;
        if (length > kResting * own) {
            if (length > kLongestStep * own) step *= kLongestStep * own / length;
            next_[i] = surface_.project(p, p + step, feet_[i]);
            if (settled_) next_[i] = surface_.settle(next_[i], feet_[i], own);
        }
        steps_[i] = next_[i] - p;
        progress.step_sum += static_cast<double>(steps_[i].norm() / own);
        // Two particles may have come nearer by twice this since their neighbours were found.
        const float drift = 0.5F * (kReach - radius) * own;
        progress.strangers += (next_[i] - found_at_[i]).squaredNorm() > drift * drift;
    }
    progress.overlap = std::sqrt(progress.overlap);
    return progress;
}

}  // namespace stipple
