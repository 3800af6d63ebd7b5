#include "stipple/splats.hpp"

#include "analysis/covariance_kernels.hpp"
#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "cloud/float4.hpp"
#include "neighbors/nearest_lists.hpp"
#include "rendering/voronoi_cell.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

// Ours. The radius is a corner of a local Voronoi cell, as in the sampling conditions of Amenta and
// Bern 1998, cut out of the tangent plane by the bisectors to the neighbours. A cell cut by fewer
// of them than there are is larger, never smaller, so the discs cover whatever was left out.

namespace stipple {

namespace {

constexpr unsigned kNeighbors = 16;  // they surround a random sample but once in 2,000
constexpr double kBorder = 0.75;     // of the mean distance to the neighbours, on an open side
constexpr std::size_t kBlock = 256;

using Vec2d = Eigen::Vector2d;

/// For each point its nearest ones, and those that have it among their nearest.
struct Neighborhoods {
    NearestLists nearest;
    std::vector<std::uint64_t> ends;  ///< of the stretch of each point in `near_to`
    std::vector<Index> near_to;

    Neighborhoods(std::span<const Vec3f> points, const RunContext& context)
        : nearest(nearest_lists(points, kNeighbors, context)),
          ends(made_in_blocks<std::vector<std::uint64_t>>(points.size(), context)) {
        const auto for_points = [&](auto&& visit) {
            for_blocks_in_order(points.size(), context, [&](std::size_t begin, std::size_t end) {
                for (std::size_t i = begin; i < end; ++i) visit(i);
            });
        };
        for_points([&](std::size_t i) {
            for (const Index j : nearest.of(i)) ++ends[j];
        });
        std::uint64_t total = 0;
        for_points([&](std::size_t i) { total += std::exchange(ends[i], total); });
        resize_in_blocks(near_to, total, context);
        // Beginnings become ends while the stretches are filled.
        for_points([&](std::size_t i) {
            for (const Index j : nearest.of(i)) near_to[ends[j]++] = static_cast<Index>(i);
        });
    }
    std::span<const Index> that_have(std::size_t i) const noexcept {
        return {near_to.data() + (i > 0 ? ends[i - 1] : 0), near_to.data() + ends[i]};
    }
};

/// Any axes in a plane.
struct TangentPlane {
    Vec3d normal = Vec3d::UnitZ(), u = normal.unitOrthogonal(), v = normal.cross(u);
};

/// Where a point's neighbours are, from it on, side by side for vector code: in fours, what is
/// missing stands at the point. In units of the way to the last of its nearest, so that no square
/// under- or overflows.
struct Surroundings {
    std::vector<float> x, y, z;
    std::size_t size = 0;
    std::size_t nearest = 0;  ///< the first are its own nearest, in order of distance
    double unit = 1;
    double most = 0;  ///< to the farthest that has the point among its nearest, input units

    void start(double unit_) noexcept {
        size = 0;
        unit = unit_;
    }
    void add(const Vec3d& offset, double per_unit) {
        if (size + 4 > x.size())
            for (auto* values : {&x, &y, &z}) values->resize(2 * size + 32);
        const Vec3f d = (offset * per_unit).cast<float>();
        x[size] = d.x();
        y[size] = d.y();
        z[size++] = d.z();
    }
    /// Puts what is missing of the last four at the point.
    void fill_up() noexcept {
        for (std::size_t i = size; i % 4 != 0; ++i) x[i] = y[i] = z[i] = 0;
    }
};

/// Puts the covariance of a point and its nearest about their mean (Eq. 4) into a lane.
void put_covariance(const Surroundings& around, EigenProblems& problems, std::size_t lane) {
    Float4 x{}, y{}, z{}, xx{}, xy{}, xz{}, yy{}, yz{}, zz{};
    const auto add = [&](Float4 dx, Float4 dy, Float4 dz) {
        x += dx;
        y += dy;
        z += dz;
        xx += dx * dx;
        xy += dx * dy;
        xz += dx * dz;
        yy += dy * dy;
        yz += dy * dz;
        zz += dz * dz;
    };
    std::size_t i = 0;
    for (; i + 4 <= around.nearest; i += 4)
        add(load(&around.x[i]), load(&around.y[i]), load(&around.z[i]));
    for (; i < around.nearest; ++i)
        add(Float4{around.x[i]}, Float4{around.y[i]}, Float4{around.z[i]});
    const Vec3d total(sum(x), sum(y), sum(z));
    const Vec3d mean = total / (static_cast<double>(around.nearest) + 1);
    problems.xx[lane] = sum(xx) - total.x() * mean.x();
    problems.yy[lane] = sum(yy) - total.y() * mean.y();
    problems.zz[lane] = sum(zz) - total.z() * mean.z();
    problems.xy[lane] = sum(xy) - total.x() * mean.y();
    problems.yz[lane] = sum(yz) - total.y() * mean.z();
    problems.zx[lane] = sum(xz) - total.z() * mean.x();
}

/// Puts the neighbours into the plane. Distances to them are as they are in space: a surface that
/// bends is longer than its shadow on the plane.
void unroll(const Surroundings& around, const TangentPlane& plane, PlanarPlaces& places) {
    places.reset(around.size);
    const Vec3f u = plane.u.cast<float>(), v = plane.v.cast<float>();
    for (std::size_t i = 0; i < around.size; i += 4) {
        const Float4 x = load(&around.x[i]), y = load(&around.y[i]), z = load(&around.z[i]);
        const Float4 along_u = u.x() * x + u.y() * y + u.z() * z,
                     along_v = v.x() * x + v.y() * y + v.z() * z;
        const Float4 shadow_sq = along_u * along_u + along_v * along_v,
                     length_sq = x * x + y * y + z * z;
        const Int4 is_apart = shadow_sq > 0.0F;
        const Float4 longer = square_root(is_apart ? length_sq / shadow_sq : Float4{});
        store(&places.x[i], longer * along_u);
        store(&places.y[i], longer * along_v);
        store(&places.length_sq[i], is_apart ? length_sq : Float4{});
    }
}

/// What a splat must reach, in its plane.
struct Footprint {
    TangentPlane plane;
    std::vector<Vec2d> corners;   ///< of a polygon about the point
    std::vector<Vec2d> half_way;  ///< to neighbours, where that is nearest to the point, too
    bool is_closed = false;       ///< whether neighbours end it on every side
    double most = 0;              ///< no splat is larger

    /// The least size of a splat that holds everything; `size_sq(place)` is the square of that of
    /// one through `place`.
    template <typename SizeSq>
    double least(SizeSq&& size_sq) const {
        double least_sq = 0;
        for (const Vec2d& place : corners) least_sq = std::max(least_sq, size_sq(place));
        for (const Vec2d& place : half_way) least_sq = std::max(least_sq, size_sq(place));
        return std::sqrt(least_sq);
    }
    double radius() const {
        return std::min(most, least([](const Vec2d& place) { return place.squaredNorm(); }));
    }
};

class FootprintFinder {
public:
    static constexpr std::size_t kLanes = 8;

    FootprintFinder(std::span<const Vec3f> points, const Neighborhoods& neighborhoods)
        : points_(points), neighborhoods_(neighborhoods) {}

    /// Calls take(i, footprint) for some points that follow each other.
    template <typename Take>
    void find(std::size_t begin, std::size_t end, Take&& take) {
        for (; begin < end; begin += kLanes) {
            const std::size_t count = std::min(kLanes, end - begin);
            problems_ = {};
            for (std::size_t lane = 0; lane < count; ++lane) {
                gather(begin + lane, around_[lane]);
                // By its nearest alone: among those that have it may be outliers.
                put_covariance(around_[lane], problems_, lane);
            }
            kernels_.solve(problems_);
            for (std::size_t lane = 0; lane < count; ++lane) {
                footprint_.plane = {{problems_.x[lane], problems_.y[lane], problems_.z[lane]}};
                footprint_.most = around_[lane].most;
                unroll(around_[lane], footprint_.plane, places_);
                cell_.find(places_);
                set_reach(around_[lane].unit);
                take(begin + lane, static_cast<const Footprint&>(footprint_));
            }
        }
    }

private:
    Vec3d offset(std::size_t from, Index to) const {
        return points_[to].cast<double>() - points_[from].cast<double>();
    }

    /// The ways to the neighbours of a point: its nearest, then the others that have it.
    void gather(std::size_t i, Surroundings& around) const {
        const auto mine = neighborhoods_.nearest.of(i), others = neighborhoods_.that_have(i);
        const double farthest_sq = mine.empty() ? 0 : offset(i, mine.back()).squaredNorm();
        around.start(farthest_sq > 0 ? std::sqrt(farthest_sq) : 1);
        around.nearest = mine.size();
        const double per_unit = 1 / around.unit;
        for (const Index j : mine) around.add(offset(i, j), per_unit);
        // What is clearly nearer than the last of its nearest is one of them.
        constexpr double kRounding = 1e-5;
        double most_sq = 0;
        for (const Index j : others) {
            const Vec3d d = offset(i, j);
            const double length_sq = d.squaredNorm();
            most_sq = std::max(most_sq, length_sq);
            if (length_sq >= (1 - kRounding) * farthest_sq &&
                std::ranges::find(mine, j) == mine.end())
                around.add(d, per_unit);
        }
        around.fill_up();
        around.most = std::sqrt(most_sq);
        if (others.empty() && !mine.empty()) {  // an outlier
            const Index nearest = mine.front();
            around.most = offset(nearest, neighborhoods_.nearest.of(nearest).back()).norm();
        }
    }

    double length_sq(int neighbor) const {
        return places_.length_sq[static_cast<std::size_t>(neighbor)];
    }

    /// Takes the cell, drawn in where it is open: where no neighbour ends it, or two that lie
    /// nearly in a line with the point do so far away, or beyond all others.
    void set_reach(double unit) {
        constexpr double kFar = 2;  // times the distance of the neighbours
        footprint_.corners.clear();
        footprint_.half_way.clear();
        double sum = 0;
        for (const VoronoiCell::Edge& edge : cell_.edges()) {
            if (!edge.is_direct) continue;
            const auto n = static_cast<std::size_t>(edge.neighbor);
            footprint_.half_way.push_back(0.5 * unit * Vec2d(places_.x[n], places_.y[n]));
            sum += std::sqrt(length_sq(edge.neighbor));
        }
        footprint_.is_closed = cell_.is_closed();
        if (footprint_.half_way.empty()) return;
        const double border = kBorder * sum / static_cast<double>(footprint_.half_way.size());
        const auto add = [&](const Vec2d& corner) { footprint_.corners.push_back(unit * corner); };
        if (!cell_.is_closed()) add({border, 0});
        const double farthest_sq = std::ranges::max(places_.length_sq);
        for (const VoronoiCell::Edge& edge : cell_.edges()) {
            if (edge.next == VoronoiCell::kOpen) continue;
            const Vec2d corner = edge.corner.cast<double>();
            const double far_sq = corner.squaredNorm();
            const double near_sq = std::max(length_sq(edge.neighbor), length_sq(edge.next));
            const bool is_end = far_sq <= std::min(farthest_sq, kFar * kFar * near_sq);
            footprint_.is_closed &= is_end;
            add(is_end || far_sq <= border * border ? corner : Vec2d(border, 0));
        }
    }

    std::span<const Vec3f> points_;
    const Neighborhoods& neighborhoods_;
    const CovarianceKernels& kernels_ = covariance_kernels();
    std::array<Surroundings, kLanes> around_;
    EigenProblems problems_;
    PlanarPlaces places_;
    VoronoiCell cell_;
    Footprint footprint_;
};

/// Second moments of a polygon about the origin.
Eigen::Matrix2d moments(std::span<const Vec2d> corners) {
    Eigen::Matrix2d sum = Eigen::Matrix2d::Zero();
    for (std::size_t i = 0; i < corners.size(); ++i) {
        const Vec2d &a = corners[i], &b = corners[(i + 1) % corners.size()];
        const double twice_area = a.x() * b.y() - a.y() * b.x();
        const Vec2d c = a + b;
        sum += twice_area / 24 * (a * a.transpose() + b * b.transpose() + c * c.transpose());
    }
    return sum;
}

/// The half axes of the ellipse of the shape of the cell that holds it; of the disc where the cell
/// is open or the ellipse too long.
std::pair<Vec3d, Vec3d> half_axes(const Footprint& footprint) {
    const auto axes = [&](const Vec2d& along, double major, double minor) {
        const TangentPlane& plane = footprint.plane;
        return std::pair<Vec3d, Vec3d>(major * (plane.u * along.x() + plane.v * along.y()),
                                       minor * (plane.v * along.x() - plane.u * along.y()));
    };
    const double radius = footprint.radius();
    if (!footprint.is_closed) return axes(Vec2d::UnitX(), radius, radius);
    const Eigen::Matrix2d spread = moments(footprint.corners);
    const double mean = 0.5 * spread.trace(), difference = 0.5 * (spread(0, 0) - spread(1, 1));
    const double root = std::hypot(difference, spread(0, 1));
    const double angle = 0.5 * std::atan2(spread(0, 1), difference);
    const Vec2d along(std::cos(angle), std::sin(angle)), across(-along.y(), along.x());
    const double aspect = mean > root ? std::sqrt((mean - root) / (mean + root)) : 1;
    const double major = footprint.least([&](const Vec2d& place) {
        const double x = place.dot(along), y = place.dot(across) / aspect;
        return x * x + y * y;
    });
    if (!(major <= footprint.most)) return axes(along, radius, radius);
    return axes(along, major, aspect * major);
}

}  // namespace

Splats measure_splats(std::span<const Vec3f> points, const SplatOptions& options,
                      const RunContext& context) {
    const std::size_t n = points.size();
    Splats splats;
    resize_in_blocks(splats.radii, n, context);
    if (options.normals) resize_in_blocks(splats.normals, n, context);
    if (options.ellipses) {
        resize_in_blocks(splats.major, n, context);
        resize_in_blocks(splats.minor, n, context);
    }
    if (n == 0) return splats;
    const Neighborhoods neighborhoods(points, context);
    context.checkpoint(0.5);
    parallel_for_blocks(n, kBlock, context, [&](std::size_t begin, std::size_t end) {
        FootprintFinder finder(points, neighborhoods);
        finder.find(begin, end, [&](std::size_t i, const Footprint& footprint) {
            splats.radii[i] = static_cast<float>(footprint.radius());
            if (options.normals) splats.normals[i] = footprint.plane.normal.cast<float>();
            if (options.ellipses) {
                const auto [major, minor] = half_axes(footprint);
                splats.major[i] = major.cast<float>();
                splats.minor[i] = minor.cast<float>();
            }
        });
    });
    context.checkpoint(1.0);
    return splats;
}

}  // namespace stipple
