#include "surface_fit.hpp"

#include "contraction.hpp"
#include "mls_fit.hpp"
#include "parallel_for.hpp"
#include "point_tree.hpp"
#include "tree_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>

// Follows: Pauly, Gross, Kobbelt 2002, §2.2 (the surface) and §4 (its distance); Erdogan and
// Fessler 1999 (separable surrogates: a step for all unknowns at once that never makes a sum of
// squares larger). The height of the surface over a place is linear in the heights of the points
// around it; so is its distance from an input point, and one sweep over these tells where all
// points have to go.

namespace stipple {
namespace {

constexpr std::size_t kNeighbors = 20;
constexpr double kReach = 3.0;  // in h
/// Weight of the squared distance to the surface of quadratic basis, that of the linear one
/// being 1. The linear surface lies inside curved parts: with less weight for the quadratic one its
/// error falls at the price of the other's, as points are pushed outward.
constexpr double kQuadraticWeight = 2.0;
/// Of the step, which for itself is rather short; the sum of squares falls for all below 2.
constexpr double kStep = 1.25;
constexpr std::size_t kBlock = 256, kBlocksAtOnce = 32;

/// What one input point asks of the points around it.
struct Wish {
    std::size_t size = 0;
    std::array<Index, kNeighbors> points;
    std::array<double, kNeighbors> pull;  ///< along the normal, times the stiffness
    std::array<double, kNeighbors> stiffness;
    Vec3d normal;
};

/// Where the points have to go, and how much speaks for it.
struct Move {
    Vec3d pull = Vec3d::Zero();
    double stiffness = 0;
};

class Fitter {
public:
    /// @param points  those of the tree.
    Fitter(const PointTree& tree, std::span<const Vec3f> points) : tree_(tree), points_(points) {}

    /// What the input point at this place asks for.
    void ask(const Vec3f& at, Wish& wish) {
        const auto found = find_nearest(tree_, at, room_);
        wish.size = 0;
        around_.resize(found.size());
        for (std::size_t i = 0; i < found.size(); ++i) {
            const Vec3d d = (points_[found[i].index] - at).cast<double>();
            around_.x[i] = d.x();
            around_.y[i] = d.y();
            around_.z[i] = d.z();
        }
        const double h = std::sqrt(static_cast<double>(found.back().distance_sq)) / kReach;
        if (!(h > 0)) return;
        const MlsPlane plane = fit_weighted_plane(around_, h);
        if (plane.kind != MlsPlane::Kind::Weighted) return;
        wish.size = found.size();
        wish.normal = plane.n;
        for (std::size_t i = 0; i < found.size(); ++i) wish.points[i] = found[i].index;
        MlsShares linear{std::span(linear_).first(wish.size)},
            quadratic{std::span(quadratic_).first(wish.size)};
        fit_shares(around_, plane.n, plane.q, h, linear, quadratic);
        wish.pull.fill(0);
        wish.stiffness.fill(0);
        add(linear, plane, 1.0, wish);
        add(quadratic, plane, kQuadraticWeight, wish);
    }

private:
    /// The distance to a surface, as each neighbour's part.
    static void add(const MlsShares& surface, const MlsPlane& plane, double weight, Wish& wish) {
        const double distance = -plane.t - surface.height;
        double total = 0;
        for (const double share : surface.shares) total += std::abs(share);
        for (std::size_t i = 0; i < wish.size; ++i) {
            wish.pull[i] += weight * distance * surface.shares[i];
            wish.stiffness[i] += weight * total * std::abs(surface.shares[i]);
        }
    }

    const PointTree& tree_;
    std::span<const Vec3f> points_;
    std::array<Neighbor, kNeighbors> room_;
    std::array<double, kNeighbors> linear_, quadratic_;
    MlsNeighborhood around_;
};

/// The members that are asked, as evenly through each list as can be.
std::vector<Index> chosen(const MemberLists& members, unsigned asked) {
    std::vector<Index> all;
    all.reserve(members.size() * asked);
    for (std::size_t i = 0; i < members.size(); ++i) {
        const auto list = members.of(i);
        const std::size_t count = std::min<std::size_t>(asked, list.size());
        for (std::size_t c = 0; c < count; ++c)
            all.push_back(list[(2 * c + 1) * list.size() / (2 * count)]);
    }
    return all;
}

}  // namespace

void fit_surface(std::vector<Vec3f>& points, std::span<const Vec3f> input,
                 const MemberLists& members, unsigned asked, const RunContext& context) {
    if (points.size() < kNeighbors) return;
    const std::vector<Index> samples = chosen(members, asked);
    // Of a size of about 1, so that no square under- or overflows.
    const auto scale = static_cast<float>(contraction_scale(points));
    for (Vec3f& p : points) p *= scale;
    const PointTree tree(points, PointTree::Leaves::Compact, context);
    std::vector<Move> moves(points.size());
    // In rounds, since what many wishes say to one point has to be added up in one order.
    constexpr std::size_t kRound = kBlock * kBlocksAtOnce;
    std::vector<Wish> wishes(std::min(kRound, samples.size()));
    for (std::size_t first = 0; first < samples.size(); first += kRound) {
        const std::size_t count = std::min(kRound, samples.size() - first);
        parallel_for_blocks(count, kBlock, context, [&](std::size_t begin, std::size_t end) {
            Fitter fitter(tree, points);
            for (std::size_t i = begin; i < end; ++i)
                fitter.ask(scale * input[samples[first + i]], wishes[i]);
        });
        for (std::size_t w = 0; w < count; ++w) {
            const Wish& wish = wishes[w];
            for (std::size_t i = 0; i < wish.size; ++i) {
                Move& move = moves[wish.points[i]];
                move.pull += wish.pull[i] * wish.normal;
                move.stiffness += wish.stiffness[i];
            }
        }
    }
    for (std::size_t i = 0; i < points.size(); ++i) {
        if (moves[i].stiffness > 0)
            points[i] += (kStep * moves[i].pull / moves[i].stiffness).cast<float>();
        points[i] /= scale;
    }
}

}  // namespace stipple
