#include "stipple/splats.hpp"

#include "first_touch.hpp"
#include "nearest_lists.hpp"
#include "parallel_for.hpp"
#include "symmetric_eigen.hpp"

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

struct TangentPlane {
    Vec3d u, v, normal;
};

/// Where a point's neighbours are, from it on.
struct Surroundings {
    std::vector<Vec3d> offsets;
    std::size_t nearest = 0;  ///< the first are its own nearest, in order of distance
    double most = 0;          ///< to the farthest that has the point among its nearest

    double farthest() const {
        double farthest_sq = 0;
        for (const Vec3d& d : offsets) farthest_sq = std::max(farthest_sq, d.squaredNorm());
        return std::sqrt(farthest_sq);
    }
};

/// Of a point and its nearest neighbours, by their covariance about their mean (Eq. 4).
TangentPlane tangent_plane(std::span<const Vec3d> offsets) {
    const double n = static_cast<double>(offsets.size()) + 1;
    Vec3d sum = Vec3d::Zero();
    Symmetric3 a;
    for (const Vec3d& d : offsets) {
        sum += d;
        a.xx += d.x() * d.x();
        a.xy += d.x() * d.y();
        a.xz += d.x() * d.z();
        a.yy += d.y() * d.y();
        a.yz += d.y() * d.z();
        a.zz += d.z() * d.z();
    }
    const Vec3d mean = sum / n;
    a.xx -= sum.x() * mean.x();
    a.xy -= sum.x() * mean.y();
    a.xz -= sum.x() * mean.z();
    a.yy -= sum.y() * mean.y();
    a.yz -= sum.y() * mean.z();
    a.zz -= sum.z() * mean.z();
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

/// A neighbour in the tangent plane.
struct Place {
    Vec2d at;
    double length_sq;
};

/// Distances to neighbours are as they are in space: a surface that bends is longer than its
/// shadow on the plane.
Place unrolled(const Vec3d& offset, const TangentPlane& plane) {
    const Vec2d shadow(offset.dot(plane.u), offset.dot(plane.v));
    const double shadow_sq = shadow.squaredNorm(), length_sq = offset.squaredNorm();
    if (!(shadow_sq > 0)) return {Vec2d::Zero(), 0};
    return {shadow * std::sqrt(length_sq / shadow_sq), length_sq};
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

    /// Whether a neighbour at that distance is too far to cut anything: half the way to it is
    /// beyond every corner.
    bool is_within(double distance_sq) const noexcept { return 0.25 * distance_sq > reach_sq_; }

    /// Keeps what is nearer to the origin than to a neighbour.
    void cut(const Place& place, int neighbor) {
        const double half_sq = 0.5 * place.length_sq;
        beyond_.resize(corners_.size());
        bool is_cut = false;
        for (std::size_t i = 0; i < corners_.size(); ++i) {
            beyond_[i] = corners_[i].place.dot(place.at) - half_sq;
            is_cut |= beyond_[i] > 0;
        }
        if (!is_cut) return;
        rest_.clear();
        reach_sq_ = 0;
        const auto keep = [&](const Vec2d& corner, int edge) {
            rest_.push_back({corner, edge});
            reach_sq_ = std::max(reach_sq_, corner.squaredNorm());
        };
        for (std::size_t i = 0; i < corners_.size(); ++i) {
            const std::size_t next = i + 1 < corners_.size() ? i + 1 : 0;
            const Corner &a = corners_[i], &b = corners_[next];
            if (beyond_[i] <= 0) keep(a.place, a.edge);
            if ((beyond_[i] <= 0) == (beyond_[next] <= 0)) continue;
            const double t = beyond_[i] / (beyond_[i] - beyond_[next]);
            // The edge that begins here is the new one where the polygon is left.
            keep(a.place + t * (b.place - a.place), beyond_[i] <= 0 ? neighbor : a.edge);
        }
        corners_.swap(rest_);
    }

    struct Corner {
        Vec2d place;
        int edge;  ///< the neighbour that cut the edge from here to the next corner
    };
    std::span<const Corner> corners() const noexcept { return corners_; }

private:
    std::vector<Corner> corners_, rest_;
    std::vector<double> beyond_;  ///< of each corner, how far it lies behind the cut, to scale
    double reach_sq_ = 0;         ///< of the farthest corner
};

/// What a splat must reach, in its plane.
struct Footprint {
    TangentPlane plane{Vec3d::UnitX(), Vec3d::UnitY(), Vec3d::UnitZ()};
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
    FootprintFinder(std::span<const Vec3f> points, const Neighborhoods& neighborhoods)
        : points_(points), neighborhoods_(neighborhoods) {}

    const Footprint& find(std::size_t i) {
        gather(i);
        footprint_.most = around_.most;
        // Of its nearest alone: among those that have it may be outliers.
        footprint_.plane = tangent_plane(std::span(around_.offsets).first(around_.nearest));
        places_.clear();
        for (const Vec3d& offset : around_.offsets)
            places_.push_back(unrolled(offset, footprint_.plane));
        cut_cell();
        set_half_way();
        set_corners();
        return footprint_;
    }

private:
    Vec3d offset(std::size_t from, Index to) const {
        return points_[to].cast<double>() - points_[from].cast<double>();
    }

    /// The ways to the neighbours of a point: its nearest, then the others that have it.
    void gather(std::size_t i) {
        const auto mine = neighborhoods_.nearest.of(i), others = neighborhoods_.that_have(i);
        around_.offsets.clear();
        around_.nearest = mine.size();
        for (const Index j : mine) around_.offsets.push_back(offset(i, j));
        // What is clearly nearer than the last of its nearest is one of them.
        constexpr double kRounding = 1e-5;
        const double surely_mine_sq =
            mine.empty() ? 0 : (1 - kRounding) * around_.offsets.back().squaredNorm();
        double most_sq = 0;
        for (const Index j : others) {
            const Vec3d d = offset(i, j);
            const double length_sq = d.squaredNorm();
            most_sq = std::max(most_sq, length_sq);
            if (length_sq >= surely_mine_sq && std::ranges::find(mine, j) == mine.end())
                around_.offsets.push_back(d);
        }
        around_.most = std::sqrt(most_sq);
        if (others.empty() && !mine.empty()) {  // an outlier
            const Index nearest = mine.front();
            around_.most = offset(nearest, neighborhoods_.nearest.of(nearest).back()).norm();
        }
    }

    void cut_cell() {
        cell_.reset(around_.farthest());
        for (std::size_t n = 0; n < places_.size(); ++n) {
            const Place& place = places_[n];
            if (place.length_sq > 0 && !cell_.is_within(place.length_sq))
                cell_.cut(place, static_cast<int>(n));
        }
    }

    const Place& of_edge(int edge) const { return places_[static_cast<std::size_t>(edge)]; }

    /// Half the ways to neighbours that are nearer to the point than to any other: these neighbours
    /// have an edge of the cell, and those that might be nearer have one as well.
    void set_half_way() {
        footprint_.half_way.clear();
        double sum = 0;
        const auto corners = cell_.corners();
        const auto is_mine = [&](const Place& neighbor) {
            constexpr double kRounding = 1e-9;
            return std::ranges::all_of(corners, [&](const Cell::Corner& corner) {
                if (corner.edge == Cell::kOpen) return true;
                const Place& other = of_edge(corner.edge);
                return other.at == neighbor.at ||
                       neighbor.at.dot(other.at) < (1 - kRounding) * other.length_sq;
            });
        };
        for (const Cell::Corner& corner : corners) {
            if (corner.edge == Cell::kOpen || !is_mine(of_edge(corner.edge))) continue;
            footprint_.half_way.emplace_back(0.5 * of_edge(corner.edge).at);
            sum += std::sqrt(of_edge(corner.edge).length_sq);
        }
        border_ = footprint_.half_way.empty()
                      ? 0
                      : kBorder * sum / static_cast<double>(footprint_.half_way.size());
    }

    /// Takes the cell, drawn in where it is open: where no neighbour ends it, or two that lie
    /// nearly in a line with the point do so far away.
    void set_corners() {
        constexpr double kFar = 2;  // times the distance of the neighbours
        footprint_.corners.clear();
        footprint_.is_closed = true;
        if (footprint_.half_way.empty()) return;
        const auto corners = cell_.corners();
        int before = corners.back().edge;
        for (const auto& [place, edge] : corners) {
            const double length_sq = place.squaredNorm();
            const bool is_open =
                edge == Cell::kOpen || before == Cell::kOpen ||
                length_sq >
                    kFar * kFar * std::max(of_edge(edge).length_sq, of_edge(before).length_sq);
            footprint_.is_closed &= !is_open;
            const bool is_drawn_in = is_open && length_sq > border_ * border_;
            footprint_.corners.emplace_back(place *
                                            (is_drawn_in ? border_ / std::sqrt(length_sq) : 1));
            before = edge;
        }
    }

    std::span<const Vec3f> points_;
    const Neighborhoods& neighborhoods_;
    Surroundings around_;
    std::vector<Place> places_;
    Cell cell_;
    double border_ = 0;  ///< how far a splat reaches where the cell is open
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
