#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace stipple {

/// Particles and how far each reaches, in buckets (§5.1, "a 3D grid data structure with
/// bucketing").
///
/// Particles of like reach share a grid whose cells are as wide as the widest of them reaches; each
/// next grid has cells half as wide. A grid is a table with about two cells a particle, laid over
/// space again and again: far particles in one cell are told apart by their distance. So neither
/// empty space nor a small region of dense particles costs anything.
class ParticleGrid {
public:
    /// @param reach  one for each position, input units, finite and positive. O(N); 28 bytes a
    /// particle.
    ParticleGrid(std::span<const Vec3f> positions, std::span<const float> reach,
                 const RunContext& context);

    /// Adds all others nearer to particle i than the mean of both reaches, in an order that depends
    /// on the particles alone.
    void append_neighbors(Index i, std::vector<Index>& found) const;

private:
    struct Entry {
        Vec3f position;
        float reach;
        Index index;
    };
    struct Level {
        double cell = 0;                 ///< width
        std::array<unsigned, 3> bits{};  ///< cells along each axis: 1 << bits
        std::size_t first_cell = 0;      ///< of this table among all

        std::size_t cells() const noexcept {
            return std::size_t{1} << (bits[0] + bits[1] + bits[2]);
        }
    };

    unsigned level_of(float reach) const noexcept;
    std::uint64_t coordinate(const Level& level, double value, int axis) const noexcept;
    std::size_t bucket_of(const Vec3f& p, const Level& level) const noexcept;
    void search(const Level& level, const Vec3f& p, float reach, Index self,
                std::vector<Index>& found) const;
    void take(std::size_t bucket_begin, std::size_t bucket_end, const Vec3f& p, float reach,
              Index self, std::vector<Index>& found) const;

    std::span<const Vec3f> positions_;
    std::span<const float> reach_;
    Vec3d low_;
    std::vector<Level> levels_;  ///< those without particles have a cell of 0
    std::vector<Index> begin_;   ///< of each bucket in `entries_`, and the end
    std::vector<Entry> entries_;
};

}  // namespace stipple
