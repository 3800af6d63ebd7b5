#pragma once

#include "particles/particle_spread.hpp"
#include "particles/particle_surface.hpp"
#include "particles/particle_tree.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

namespace stipple {

/// The force on a particle at p due to one at p_i for a force constant k = 1: (r - |p - p_i|) times
/// the unit vector away from p_i, which is Eq. 7 (§3.3) with p - p_i normalised. None from the
/// repulsion radius r on, and none where both coincide.
inline Vec3f repulsion(const Vec3f& p, const Vec3f& p_i, float r) noexcept {
    const Vec3f away = p - p_i;
    const float distance_sq = away.squaredNorm();
    if (!(distance_sq > 0 && distance_sq < r * r)) return Vec3f::Zero();
    const float distance = std::sqrt(distance_sq);
    return away * ((r - distance) / distance);
}

/// Particles that repel each other on a surface (§3.3).
class ParticleRelaxation {
public:
    /// @param spacing  wanted distance of neighbours at each sample of the surface, up to a factor
    /// that all have in common, which is found; finite, positive.
    /// @param start  at least one particle.
    ParticleRelaxation(const ParticleSurface& surface, std::vector<float> spacing,
                       SpreadParticles start, const RunContext& context);

    /// How far an iteration moved the particles and how close they are.
    struct Progress {
        double mean_step = 0;     ///< over the spacing
        bool knows_all = true;    ///< whether no particle may have neighbours not known yet
        std::size_t crowded = 0;  ///< particles that overlap another by 5 % of r or more
    };

    /// One step of all particles at once, with r = `radius` times their spacing, below `kReach`.
    /// @param find_spacing  whether the common factor may still change.
    Progress step(float radius, bool find_spacing);

    /// Puts particles halfway between neighbours, where those are farthest apart, until there are
    /// `most` or every such place is taken; the spacing shrinks accordingly. There are about three
    /// places for each particle on a surface. False, and nothing done, where they are few.
    bool split(std::size_t most);

    /// Takes particles that overlap another with this radius away and puts them where others are
    /// farthest apart, as far as there is room. False where none were moved.
    bool relocate(float radius);

    /// Puts all particles on the moving least squares surface; further steps keep them there.
    void settle();

    std::span<const Vec3f> positions() const noexcept { return positions_; }
    /// The spacing at particle i.
    float spacing(std::size_t i) const noexcept { return factor_ * places_[i][3]; }

    static constexpr float kReach = 1.6F;  ///< neighbours are known so far, over the spacing

private:
    struct BlockProgress {
        double step_sum = 0;
        std::size_t crowded = 0;
        std::size_t strangers =
            0;  ///< so far from where their neighbours were found that they may have others
    };

    /// A place on the surface halfway between neighbours i < j, with no other particle in the
    /// sphere that has them as poles.
    struct Place {
        float room;  ///< the distance of i and j over their spacing
        Index i, j;
        Vec3f position;
        ParticleSurface::Foot foot;
    };

    std::vector<Place> places_between(float least_room) const;
    void insert(std::vector<Place> places, const std::vector<std::uint8_t>& leaving);
    void resize(std::size_t count);
    void update_places();
    void find_neighbors();
    double mean_ring() const;
    bool is_awake(std::size_t i) const noexcept;
    float mean_of_ring(std::size_t i) const;
    Vec3f force_on(std::size_t i, float radius, bool& is_crowded) const;
    void fetch_ahead_of(std::size_t i, std::size_t end) const noexcept;
    BlockProgress move(std::size_t begin, std::size_t end, float radius);

    const ParticleSurface& surface_;
    RunContext context_;
    std::vector<float> spacing_;  ///< at the samples, up to `factor_`
    float factor_ = 1;
    std::vector<Vec3f> positions_, next_, steps_;
    std::vector<std::array<float, 4>> places_;  ///< x, y, z and `spacing_` of each
    std::vector<std::uint8_t> moved_, moves_;   ///< by the last step, and by this one
    std::vector<ParticleSurface::Foot> feet_;
    std::vector<ParticleNeighborhoods> neighborhoods_;  ///< of each block
    std::vector<Vec3f> found_at_;                       ///< the positions when they were found
    std::vector<BlockProgress> progress_;
    std::size_t strangers_ = 0;
    float radius_ = 0;  ///< of the last step
    unsigned age_ = 0;  ///< steps since the neighbours were found
    bool settled_ = false;
};

}  // namespace stipple
