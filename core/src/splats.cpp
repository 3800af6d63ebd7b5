#include "stipple/splats.hpp"

#include "first_touch.hpp"
#include "parallel_for.hpp"
#include "stipple/neighbors.hpp"
#include "symmetric_eigen.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

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
    NeighborLists nearest;
    std::vector<std::uint64_t> offsets;  ///< N + 1, of `near_to`
    std::vector<Index> near_to;

    Neighborhoods(std::span<const Vec3f> points, const RunContext& context)
        : nearest(k_nearest_neighbors(points, kNeighbors, context)),
          offsets(made_in_blocks<std::vector<std::uint64_t>>(points.size() + 1, context)) {
        const auto each_list = [&](auto&& visit) {
            for_blocks_in_order(points.size(), context, [&](std::size_t begin, std::size_t end) {
                for (std::size_t i = begin; i < end; ++i) visit(i, nearest.of(i));
            });
        };
        each_list([&](std::size_t, std::span<const Index> list) {
            for (const Index j : list) ++offsets[j + std::size_t{1}];
        });
        auto next = made_in_blocks<std::vector<std::uint64_t>>(points.size(), context);
        each_list([&](std::size_t i, auto) {
            next[i] = offsets[i];
            offsets[i + 1] += offsets[i];
        });
        resize_in_blocks(near_to, nearest.indices.size(), context);
        each_list([&](std::size_t i, std::span<const Index> list) {
            for (const Index j : list) near_to[next[j]++] = static_cast<Index>(i);
        });
    }
    std::span<const Index> that_have(std::size_t i) const noexcept {
        return {near_to.data() + offsets[i], near_to.data() + offsets[i + 1]};
    }
};

struct TangentPlane {
    Vec3d u, v, normal;
};

/// Of a point and its neighbours, by their covariance about their mean (Eq. 4).
TangentPlane tangent_plane(std::span<const Vec3d> offsets) {
    const double n = static_cast<double>(offsets.size()) + 1;
    Vec3d mean = Vec3d::Zero();
    for (const Vec3d& d : offsets) mean += d / n;
    Symmetric3 a{mean.x() * mean.x(), mean.x() * mean.y(), mean.x() * mean.z(),
                 mean.y() * mean.y(), mean.y() * mean.z(), mean.z() * mean.z()};  // the point's
    for (const Vec3d& offset : offsets) {
        const Vec3d d = offset - mean;
        a.xx += d.x() * d.x();
        a.xy += d.x() * d.y();
        a.xz += d.x() * d.z();
        a.yy += d.y() * d.y();
        a.yz += d.y() * d.z();
        a.zz += d.z() * d.z();
    }
    const auto lambda = eigenvalues(a);
    TangentPlane plane;
    plane.u = eigenvector(a, lambda[2]);
    const Vec3d least = eigenvector(a, lambda[0]);
    const Vec3d across = least - plane.u * plane.u.dot(least);
    constexpr double kParallel = 1e-3;  // on a line, whose normal is any
    plane.normal =
        across.norm() > kParallel ? Vec3d(across.normalized()) : plane.u.unitOrthogonal();
    plane.v = plane.normal.cross(plane.u);
    return plane;
}

/// A convex polygon about the origin; each edge knows what cut it.
class Cell {
public:
    static constexpr int kOpen = -1;

    /// A square that no neighbour has cut.
    void reset(double half_side) {
        corners_.clear();
        corners_.push_back({Vec2d(-half_side, -half_side), kOpen});
        corners_.push_back({Vec2d(half_side, -half_side), kOpen});
        corners_.push_back({Vec2d(half_side, half_side), kOpen});
        corners_.push_back({Vec2d(-half_side, half_side), kOpen});
        reach_sq_ = 2 * half_side * half_side;
    }

    /// Keeps what is nearer to the origin than to `q`.
    void cut(const Vec2d& q, int neighbor) {
        const double half_sq = 0.5 * q.squaredNorm();
        if (0.5 * half_sq > reach_sq_) return;  // half the way is beyond every corner
        rest_.clear();
        for (std::size_t i = 0; i < corners_.size(); ++i) {
            const Corner& a = corners_[i];
            const Corner& b = corners_[(i + 1) % corners_.size()];
            const double beyond_a = a.place.dot(q) - half_sq, beyond_b = b.place.dot(q) - half_sq;
            if (beyond_a <= 0) rest_.push_back(a);
            if ((beyond_a <= 0) == (beyond_b <= 0)) continue;
            const double t = beyond_a / (beyond_a - beyond_b);
            // The edge that begins here is the new one where the polygon is left.
            rest_.push_back({a.place + t * (b.place - a.place), beyond_a <= 0 ? neighbor : a.edge});
        }
        corners_.swap(rest_);
        reach_sq_ = 0;
        for (const Corner& corner : corners_)
            reach_sq_ = std::max(reach_sq_, corner.place.squaredNorm());
    }

    struct Corner {
        Vec2d place;
        int edge;  ///< the neighbour that cut the edge from here to the next corner
    };
    std::span<const Corner> corners() const noexcept { return corners_; }

private:
    std::vector<Corner> corners_, rest_;
    double reach_sq_ = 0;  ///< of the farthest corner
};

/// What a splat must reach, in its plane.
struct Footprint {
    TangentPlane plane{Vec3d::UnitX(), Vec3d::UnitY(), Vec3d::UnitZ()};
    std::vector<Vec2d> corners;   ///< of a polygon about the point
    std::vector<Vec2d> half_way;  ///< to neighbours, where that is nearest to the point, too
    bool is_closed = false;       ///< whether neighbours end it on every side
    double most = 0;              ///< no splat is larger

    /// The least size of a splat that holds everything; `size(place)` is that of one through
    /// `place`.
    template <typename Size>
    double least(Size&& size) const {
        double least = 0;
        for (const Vec2d& place : corners) least = std::max(least, size(place));
        for (const Vec2d& place : half_way) least = std::max(least, size(place));
        return least;
    }
    double radius() const {
        return std::min(most, least([](const Vec2d& place) { return place.norm(); }));
    }
};

/// Distances to neighbours are as they are in space: a surface that bends is longer than its
/// shadow on the plane.
Vec2d unrolled(const Vec3d& offset, const TangentPlane& plane) {
    const Vec2d shadow(offset.dot(plane.u), offset.dot(plane.v));
    const double length = shadow.norm();
    return length > 0 ? Vec2d(shadow * (offset.norm() / length)) : Vec2d(0, 0);
}

/// Whether half the way to a neighbour is nearer to this point than to any other neighbour.
bool is_half_way_mine(const Vec2d& neighbor, std::span<const Vec2d> neighbors) {
    constexpr double kRounding = 1e-9;
    const double length_sq = neighbor.squaredNorm();
    return std::ranges::all_of(neighbors, [&](const Vec2d& other) {
        const double enough = (1 - kRounding) * other.squaredNorm();
        // One that is clearly farther cannot be nearer to a place on the way.
        return enough > (1 + kRounding) * length_sq || other == neighbor ||
               neighbor.dot(other) < enough;
    });
}

/// Takes the cell, drawn in where it is open: where no neighbour ends it, or two that lie nearly in
/// a line with the point do so far away.
void set_reach(const Cell& cell, std::span<const Vec2d> neighbors, Footprint& footprint) {
    constexpr double kFar = 2;  // times the distance of the neighbours
    footprint.half_way.clear();
    footprint.corners.clear();
    footprint.is_closed = true;
    double sum = 0;
    for (const Vec2d& neighbor : neighbors) {
        if (!(neighbor.squaredNorm() > 0) || !is_half_way_mine(neighbor, neighbors)) continue;
        footprint.half_way.emplace_back(0.5 * neighbor);
        sum += neighbor.norm();
    }
    if (footprint.half_way.empty()) return;
    const double border = kBorder * sum / static_cast<double>(footprint.half_way.size());
    const auto corners = cell.corners();
    for (std::size_t i = 0; i < corners.size(); ++i) {
        const int edge = corners[i].edge,
                  before = corners[(i + corners.size() - 1) % corners.size()].edge;
        const double length = corners[i].place.norm();
        const auto distance = [&](int n) { return neighbors[static_cast<std::size_t>(n)].norm(); };
        const bool is_open = edge == Cell::kOpen || before == Cell::kOpen ||
                             length > kFar * std::max(distance(edge), distance(before));
        footprint.is_closed &= !is_open;
        const bool is_drawn_in = is_open && length > border;
        footprint.corners.emplace_back(corners[i].place * (is_drawn_in ? border / length : 1));
    }
}

class FootprintFinder {
public:
    FootprintFinder(std::span<const Vec3f> points, const Neighborhoods& neighborhoods)
        : points_(points), neighborhoods_(neighborhoods) {}

    const Footprint& find(std::size_t i) {
        gather(i);
        footprint_.most = most_;
        // Of its nearest alone: among those that have it may be outliers.
        footprint_.plane =
            tangent_plane(std::span(offsets_).first(neighborhoods_.nearest.of(i).size()));
        places_.clear();
        for (const Vec3d& offset : offsets_) places_.push_back(unrolled(offset, footprint_.plane));
        cell_.reset(farthest_);
        for (std::size_t n = 0; n < places_.size(); ++n) {
            if (places_[n].squaredNorm() > 0) cell_.cut(places_[n], static_cast<int>(n));
        }
        set_reach(cell_, places_, footprint_);
        return footprint_;
    }

private:
    Vec3d offset(std::size_t from, Index to) const {
        return points_[to].cast<double>() - points_[from].cast<double>();
    }

    /// The ways to the neighbours of a point: its nearest, then the others that have it.
    void gather(std::size_t i) {
        const auto mine = neighborhoods_.nearest.of(i), others = neighborhoods_.that_have(i);
        offsets_.clear();
        farthest_ = most_ = 0;
        const auto add = [&](Index j) {
            offsets_.push_back(offset(i, j));
            farthest_ = std::max(farthest_, offsets_.back().norm());
        };
        for (const Index j : mine) add(j);
        for (const Index j : others) {
            most_ = std::max(most_, offset(i, j).norm());
            if (std::ranges::find(mine, j) == mine.end()) add(j);
        }
        if (others.empty() && !mine.empty()) {  // an outlier
            const Index nearest = mine.front();
            most_ = offset(nearest, neighborhoods_.nearest.of(nearest).back()).norm();
        }
    }

    std::span<const Vec3f> points_;
    const Neighborhoods& neighborhoods_;
    std::vector<Vec3d> offsets_;
    std::vector<Vec2d> places_;
    Cell cell_;
    double farthest_ = 0, most_ = 0;
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
        return std::hypot(place.dot(along), place.dot(across) / aspect);
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
        for (std::size_t i = begin; i < end; ++i) {
            const Footprint& footprint = finder.find(i);
            splats.radii[i] = static_cast<float>(footprint.radius());
            if (options.normals) splats.normals[i] = footprint.plane.normal.cast<float>();
            if (options.ellipses) {
                const auto [major, minor] = half_axes(footprint);
                splats.major[i] = major.cast<float>();
                splats.minor[i] = minor.cast<float>();
            }
        }
    });
    context.checkpoint(1.0);
    return splats;
}

}  // namespace stipple
