#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace stipple {

/// Eight places x, each with candidates of its own for its neighbourhood; the planes of weighted
/// least squares there (§2.2, h = r / 3); and a query's way across each. Everything of one lane is
/// relative to a place near its candidates, so that floats are exact enough.
struct PlaneLanes {
    static constexpr std::size_t kLanes = 8;
    static constexpr float kNowhere = 1e15F;  ///< a coordinate of a candidate that is missing
    using Floats = std::array<float, kLanes>;
    struct alignas(32) Row {
        Floats x, y, z;
    };
    /// Coordinate by coordinate: groups of eight, the last filled up with what is missing. At least
    /// k are there; a lane without groups is left out.
    struct Candidates {
        const float *x = nullptr, *y = nullptr, *z = nullptr;
        std::uint32_t groups = 0;
    };

    /// @param k  size of a neighbourhood. @param capacity  candidates of a lane, at least k.
    PlaneLanes(unsigned k_, std::size_t capacity)
        : k(k_), scratch((capacity + kLanes - 1) / kLanes * kLanes) {}

    unsigned k;
    std::array<Candidates, kLanes> candidates{};
    std::vector<float> scratch;
    Row place{}, query{};
    Floats radius_guess_sq{};  ///< of the neighbourhood: anything, but a good one saves time

    // What comes out.
    Floats radius_sq{};               ///< squared distance from the place to its k-th candidate
    Floats nearest_sq{};              ///< and to the nearest
    Row foot{};                       ///< the query projected onto the plane
    Row normal{};                     ///< of the plane, unit
    Floats offset_sq{};               ///< from the place to the weighted mean of its neighbourhood
    Floats roundness{};               ///< λ0 / λ1 of the neighbourhood: 0 on a plane, 1 where its
                                      ///< normal is arbitrary
    Floats breadth{};                 ///< λ1 / λ2: 0 on a line
    Floats height{};                  ///< of the query over it
    Floats step_sq{};                 ///< from the place to the foot
    std::array<bool, kLanes> flat{};  ///< false where the candidates carry no plane
};

/// Computes what comes out of eight lanes, for one instruction set. Every set gives the same bits.
struct PlaneKernel {
    const char* name;
    void (*run)(PlaneLanes& lanes) noexcept;
};

/// What this machine can run, the plainest first.
std::vector<PlaneKernel> available_plane_kernels();

/// The quickest of them.
const PlaneKernel& plane_kernel();

}  // namespace stipple
