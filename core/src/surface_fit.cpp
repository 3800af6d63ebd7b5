#include "surface_fit.hpp"

#include "contraction.hpp"
#include "float4.hpp"
#include "mls_fit.hpp"
#include "parallel_for.hpp"
#include "point_tree.hpp"
#include "tree_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>

// Follows: Pauly, Gross, Kobbelt 2002, §2.2 (the surface) and §4 (its distance); Levenberg 1944 (a
// step towards the least sum of squares, damped); Hestenes and Stiefel 1952 (conjugate gradients
// for the points of a patch together: what one of them does the surface for its neighbours need not
// do again).

namespace stipple {
namespace {

constexpr std::size_t kNeighbors = 20;
constexpr double kReach = 3.0;  // in h
constexpr std::size_t kBlock = 64;
/// Points of a patch, at least; fewer than twice as many.
constexpr std::size_t kPatch = 4096;

/// What a move costs, as a part of what the wishes weigh at a point on average.
constexpr float kDamping = 0.5F;
constexpr int kIterations = 3;

/// What one input point asks of the points around it: that moves along the gradients of the
/// surface's height, linear and quadratic, add up to its distance from it.
struct Wish {
    std::size_t size = 0;
    std::array<Index, kNeighbors> points;
    std::array<Float4, kNeighbors> linear, quadratic;
    float linear_distance = 0, quadratic_distance = 0;

    std::span<const Index> points_asked() const { return std::span(points).first(size); }
};

Float4 packed(const Vec3d& v) {
    const Vec3f f = v.cast<float>();
    return Float4{f.x(), f.y(), f.z(), 0};
}

float sum(Float4 v) {
    return (v[0] + v[1]) + (v[2] + v[3]);
}

class Asker {
public:
    /// @param points  those of the tree.
    Asker(const PointTree& tree, std::span<const Vec3f> points) : tree_(tree), points_(points) {}

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
        MlsGradients linear{.gradients = linear_}, quadratic{.gradients = quadratic_};
        fit_gradients(around_, plane.n, plane.q, h, linear, quadratic);
        wish.size = found.size();
        for (std::size_t i = 0; i < wish.size; ++i) {
            wish.points[i] = found[i].index;
            wish.linear[i] = packed(linear_[i]);
            wish.quadratic[i] = packed(quadratic_[i]);
        }
        wish.linear_distance = static_cast<float>(-plane.t - linear.height);
        wish.quadratic_distance = static_cast<float>(-plane.t - quadratic.height);
    }

private:
    const PointTree& tree_;
    std::span<const Vec3f> points_;
    std::array<Neighbor, kNeighbors> room_;
    std::array<Vec3d, kNeighbors> linear_, quadratic_;
    MlsNeighborhood around_;
};

/// Weighs the quadratic surface as much as the linear one, and more where it is the closer by far:
/// where points that are pushed out until the linear surface, which lies inside, meets the input
/// half way would spoil it.
void weigh_quadratic(std::span<Wish> wishes, std::size_t size) {
    std::vector<float> between(size), beside(size);  // squared: the surfaces, the input
    for (const Wish& wish : wishes) {
        const float inside = wish.linear_distance - wish.quadratic_distance;
        for (const Index p : wish.points_asked()) {
            between[p] += inside * inside;
            beside[p] += wish.quadratic_distance * wish.quadratic_distance;
        }
    }
    for (Wish& wish : wishes) {
        double b = 0, q = 0;
        for (const Index p : wish.points_asked()) {
            b += static_cast<double>(between[p]);
            q += static_cast<double>(beside[p]);
        }
        if (!(b > 4 * q && q > 0)) continue;
        constexpr double kMost = 4;  // or damping, which is one for all, would hold the others
        const auto factor = static_cast<float>(std::min(std::sqrt(b / q) / 2, kMost));
        wish.quadratic_distance *= factor;
        for (Float4& gradient : wish.quadratic) gradient *= factor;
    }
}

/// Damped least squares by conjugate gradients: the moves of all points that please their wishes
/// best.
class Agreement {
public:
    /// @param size  of what `Wish::points` number.
    Agreement(std::span<const Wish> wishes, std::size_t size)
        : wishes_(wishes), residual_(size), direction_(size), image_(size), stiffness_(size) {
        double total = 0;
        for (const Wish& wish : wishes) {
            for (std::size_t i = 0; i < wish.size; ++i) {
                const Float4 l = wish.linear[i], q = wish.quadratic[i];
                const Index p = wish.points[i];
                residual_[p] += wish.linear_distance * l + wish.quadratic_distance * q;
                const float square = sum(l * l + q * q);
                stiffness_[p] += square;
                total += static_cast<double>(square);
            }
        }
        damping_ = kDamping * static_cast<float>(total / static_cast<double>(size));
    }

    std::vector<Float4> moves(const RunContext& context) {
        std::vector<Float4> moved(residual_.size());
        double length = turn(0);
        for (int i = 0; i < kIterations && length > 0; ++i) {
            context.throw_if_stopped();
            const auto step = static_cast<float>(length / look_along());
            for (std::size_t p = 0; p < moved.size(); ++p) {
                moved[p] += step * direction_[p];
                residual_[p] -= step * image_[p];
            }
            length = turn(length);
        }
        return moved;
    }

private:
    /// The next direction, conjugate to the last. @return the residual's squared length.
    double turn(double length_before) {
        double length = 0;
        const auto scaled = [&](std::size_t p) {
            return residual_[p] / (stiffness_[p] + damping_);
        };
        if (!(damping_ > 0)) return 0;
        for (std::size_t p = 0; p < residual_.size(); ++p)
            length += static_cast<double>(sum(residual_[p] * scaled(p)));
        const auto kept = static_cast<float>(length_before > 0 ? length / length_before : 0);
        for (std::size_t p = 0; p < residual_.size(); ++p)
            direction_[p] = scaled(p) + kept * direction_[p];
        return length;
    }

    /// What all wishes and the damping say of the direction. @return its curvature.
    double look_along() {
        for (std::size_t p = 0; p < image_.size(); ++p) image_[p] = damping_ * direction_[p];
        for (const Wish& wish : wishes_) {
            Float4 l{}, q{};
            for (std::size_t i = 0; i < wish.size; ++i) {
                l += wish.linear[i] * direction_[wish.points[i]];
                q += wish.quadratic[i] * direction_[wish.points[i]];
            }
            const float linear = sum(l), quadratic = sum(q);
            for (std::size_t i = 0; i < wish.size; ++i)
                image_[wish.points[i]] += linear * wish.linear[i] + quadratic * wish.quadratic[i];
        }
        double curvature = 0;
        for (std::size_t p = 0; p < image_.size(); ++p)
            curvature += static_cast<double>(sum(direction_[p] * image_[p]));
        return curvature;
    }

    std::span<const Wish> wishes_;
    std::vector<Float4> residual_, direction_, image_;
    std::vector<float> stiffness_;
    float damping_ = 0;
};

/// Fits points patch by patch, each with the wishes for those around it too, which then are
/// dropped: so their memory is bounded.
class Fitter {
public:
    /// @param scale  times the input, that is where the points are.
    Fitter(std::span<const Vec3f> points, std::span<const Vec3f> input, float scale,
           const MemberLists& members, unsigned asked, const RunContext& context)
        : points_(points),
          input_(input),
          scale_(scale),
          members_(members),
          asked_(asked),
          context_(context),
          tree_(points, PointTree::Leaves::Compact, context),
          number_(points.size(), PointTree::kNone) {}

    std::vector<Vec3f> fitted() {
        std::vector<Vec3f> result(points_.begin(), points_.end());
        const std::size_t patches = std::max<std::size_t>(1, points_.size() / kPatch);
        for (std::size_t patch = 0; patch < patches; ++patch) {
            const std::size_t begin = patch * points_.size() / patches,
                              end = (patch + 1) * points_.size() / patches;
            for (std::size_t i = begin; i < end; ++i)
                number(tree_.leaf(i / PointTree::kWidth).index[i % PointTree::kWidth]);
            wishes_.clear();
            ask_for(0, end - begin);
            ask_for(end - begin, numbered_.size());
            weigh_quadratic(wishes_, numbered_.size());
            const auto moved = Agreement(wishes_, numbered_.size()).moves(context_);
            for (std::size_t i = 0; i < end - begin; ++i)
                result[numbered_[i]] += Vec3f(moved[i][0], moved[i][1], moved[i][2]);
            for (const Index p : numbered_) number_[p] = PointTree::kNone;
            numbered_.clear();
        }
        return result;
    }

private:
    Index number(Index point) {
        if (number_[point] == PointTree::kNone) {
            number_[point] = static_cast<Index>(numbered_.size());
            numbered_.push_back(point);
        }
        return number_[point];
    }

    /// Adds the wishes of what the numbered points `begin .. end` stand for, and numbers the points
    /// that they are about.
    void ask_for(std::size_t begin, std::size_t end) {
        std::vector<Index> samples;
        for (std::size_t i = begin; i < end; ++i) {
            const auto list = members_.of(numbered_[i]);
            const std::size_t count = std::min<std::size_t>(asked_, list.size());
            for (std::size_t c = 0; c < count; ++c)  // as evenly through the list as can be
                samples.push_back(list[(2 * c + 1) * list.size() / (2 * count)]);
        }
        const std::size_t first = wishes_.size();
        wishes_.resize(first + samples.size());
        parallel_for_blocks(samples.size(), kBlock, context_,
                            [&](std::size_t block_begin, std::size_t block_end) {
                                Asker asker(tree_, points_);
                                for (std::size_t i = block_begin; i < block_end; ++i)
                                    asker.ask(scale_ * input_[samples[i]], wishes_[first + i]);
                            });
        for (Wish& wish : std::span(wishes_).subspan(first))
            for (std::size_t i = 0; i < wish.size; ++i) wish.points[i] = number(wish.points[i]);
    }

    std::span<const Vec3f> points_, input_;
    float scale_;
    const MemberLists& members_;
    unsigned asked_;
    const RunContext& context_;
    PointTree tree_;
    std::vector<Index> numbered_;  ///< points of the patch, then those around it
    std::vector<Index> number_;    ///< in that order, by point; else kNone
    std::vector<Wish> wishes_;
};

}  // namespace

void fit_surface(std::vector<Vec3f>& points, std::span<const Vec3f> input,
                 const MemberLists& members, unsigned asked, const RunContext& context) {
    if (points.size() < kNeighbors) return;
    // Of a size of about 1, so that no square under- or overflows.
    const auto scale = static_cast<float>(contraction_scale(points));
    for (Vec3f& p : points) p *= scale;
    points = Fitter(points, input, scale, members, asked, context).fitted();
    for (Vec3f& p : points) p /= scale;
}

}  // namespace stipple
