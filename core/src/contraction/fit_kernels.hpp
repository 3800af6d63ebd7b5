#pragma once

#include <array>
#include <cstddef>
#include <vector>

namespace stipple {

/// What is common to eight places that are asked for the height of the surface, each among
/// neighbours of its own. Everything of one lane is relative to a point near its neighbours, so
/// that floats are exact enough.
struct FitLanes {
    static constexpr std::size_t kLanes = 8;
    static constexpr std::size_t kRows = 20;  ///< neighbours
    using Floats = std::array<float, kLanes>;
    struct alignas(32) Row {
        Floats x, y, z;
    };

    Row around[kRows];
    Row place;     ///< no neighbour may be farther away than 6 h
    Floats per_h;  ///< 1 / h; 0 where nothing is asked
};

/// What comes out for them: that moves of the neighbours along these gradients of the surface's
/// height over the plane of weighted least squares, with linear and with quadratic basis (§2.2),
/// must add up to these distances for the surface to meet the place. n, q and h are held fast. All
/// is 0 where nothing is asked and where the neighbours carry no plane.
struct FitAnswers {
    struct alignas(32) Gradients {
        FitLanes::Row linear, quadratic;
    };
    Gradients gradients[FitLanes::kRows];
    FitLanes::Floats linear_distance, quadratic_distance;
};

/// The answers of some places for each of the same eight lanes of neighbours; what is said with
/// quadratic basis counts `quadratic_weight` times.
struct FitWishes {
    const FitAnswers* answers;
    std::size_t count;
    FitLanes::Floats quadratic_weight;
};

/// The inner loops of the fit of points to a surface, for one instruction set. Every set gives the
/// same bits.
struct FitKernel {
    const char* name;
    /// Answers eight places.
    void (*run)(const FitLanes& lanes, FitAnswers& answers) noexcept;
    /// Whether the neighbours around the place lie in two layers (layers.hpp): 1, else 0.
    void (*layers)(const FitLanes& lanes, FitLanes::Floats& layered) noexcept;
    /// For each neighbour the sum of gradients times distances, and that of the squared gradients.
    void (*want)(const FitWishes& wishes, FitLanes::Row* wanted,
                 FitLanes::Floats* squares) noexcept;
    /// For each neighbour the sum of gradients times what moves along `direction` add up to.
    void (*look_along)(const FitWishes& wishes, const FitLanes::Row* direction,
                       FitLanes::Row* image) noexcept;
};

/// What this machine can run, the plainest first.
std::vector<FitKernel> available_fit_kernels();

/// The quickest of them.
const FitKernel& fit_kernel();

}  // namespace stipple
