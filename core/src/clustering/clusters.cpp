#include "stipple/clusters.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "base/symmetric_eigen.hpp"
#include "cloud/float4.hpp"
#include "cloud/srgb.hpp"
#include "clustering/gather.hpp"
#include "clustering/representatives.hpp"
#include "clustering/sample_moments.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <cmath>

// Follows: Pauly, Gross, Kobbelt 2002, §3.1 (centroids). The surface representative is ours:
// centroids of curved parts lie inside the surface by half the mean curvature times the mean
// squared radius (the shrinkage of §5.2), which a quadratic height field over the cluster's own
// plane undoes.

namespace stipple {

namespace {

constexpr std::size_t kClustersPerBlock = 256;
constexpr Index kMinSurfaceFit = 6;  // fewer samples do not carry two curvatures and a height

/// The principal frame of a cluster: u and v span its plane.
struct Frame {
    Vec3d u, v, normal;
};

/// Sums over a cluster in its frame, for w = a + b u^2 + c v^2; lengths in units of `scale`, so
/// that floats carry them.
struct HeightSums {
    double uu = 0, vv = 0, uuuu = 0, uuvv = 0, vvvv = 0, wuu = 0, wvv = 0, w_min = 0, w_max = 0;

    void add_all(const SampleSpan& samples, const Vec3d& centroid, const Frame& frame,
                 double scale) {
        const Vec3f reference = centroid.cast<float>();
        const Vec3f u_axis = (frame.u / scale).cast<float>(),
                    v_axis = (frame.v / scale).cast<float>(),
                    w_axis = (frame.normal / scale).cast<float>();
        const auto along = [](const Group& g, const Vec3f& axis) {
            return g.x * axis.x() + g.y * axis.y() + g.z * axis.z();
        };
        std::array<Float4, 7> part{};
        Float4 low{}, high{};
        const auto add = [&](const Group& g) {
            const Float4 u = along(g, u_axis), v = along(g, v_axis), w = along(g, w_axis);
            const Float4 u2 = u * u, v2 = v * v;
            const std::array<Float4, 7> terms = {u2, v2, u2 * u2, u2 * v2, v2 * v2, w * u2, w * v2};
            for (std::size_t k = 0; k < part.size(); ++k) part[k] += terms[k];
            low = w < low ? w : low;
            high = w > high ? w : high;
        };
        const auto flush = [&] {
            const std::array<double*, 7> totals = {&uu, &vv, &uuuu, &uuvv, &vvvv, &wuu, &wvv};
            for (std::size_t k = 0; k < part.size(); ++k) {
                *totals[k] += sum(part[k]);
                part[k] = Float4{};
            }
        };
        const std::size_t whole = samples.size / 4 * 4;
        constexpr std::size_t kFlush = 128;  // samples summed up in floats
        std::size_t i = 0;
        for (; i + kFlush <= whole; flush()) {
            for (const std::size_t end = i + kFlush; i < end; i += 4)
                add(Group(samples, i, reference));
        }
        for (; i < whole; i += 4) add(Group(samples, i, reference));
        if (i < samples.size) add(Group::tail(samples, i, reference));
        flush();
        for (int lane = 0; lane < 4; ++lane) {
            w_min = std::min(w_min, static_cast<double>(low[lane]));
            w_max = std::max(w_max, static_cast<double>(high[lane]));
        }
    }
};

/// The centroid moved along the normal onto w = a + b u^2 + c v^2, fitted by least squares.
Vec3d surface_point(Gathered& gathered, std::span<const Index> members,
                    const SampleMoments& moments) {
    const auto lambda = eigenvalues(moments.scatter);
    if (members.size() < kMinSurfaceFit || !(lambda[1] > 0)) return moments.centroid;
    const Vec3d longest = eigenvector(moments.scatter, lambda[2]);
    Frame frame;
    frame.normal = eigenvector(moments.scatter, lambda[0]);
    frame.u = (longest - frame.normal * frame.normal.dot(longest)).normalized();
    frame.v = frame.normal.cross(frame.u);
    const double n = static_cast<double>(members.size());
    const double scale = std::sqrt(lambda[2] / n);
    HeightSums s;
    gathered.each_piece(members, [&](const SampleSpan& samples) {
        s.add_all(samples, moments.centroid, frame, scale);
    });
    // The mean of w is 0, so with u^2 and v^2 centred the normal equations are 2 x 2, and a = -(b
    // uu + c vv) / n.
    const double a11 = s.uuuu - s.uu * s.uu / n, a12 = s.uuvv - s.uu * s.vv / n,
                 a22 = s.vvvv - s.vv * s.vv / n;
    const double determinant = a11 * a22 - a12 * a12;
    constexpr double kSingular = 1e-9;
    if (!(determinant > kSingular * a11 * a22)) return moments.centroid;
    const double b = (s.wuu * a22 - s.wvv * a12) / determinant;
    const double c = (s.wvv * a11 - s.wuu * a12) / determinant;
    // The surface at the centre lies among the samples, whatever noise makes of the fit.
    const double height = std::clamp(-(b * s.uu + c * s.vv) / n, s.w_min, s.w_max) * scale;
    return moments.centroid + frame.normal * height;
}

constexpr const char* kColor = "color";
constexpr const char* kNormal = "normal";

struct LinearColor {
    double r = 0, g = 0, b = 0, a = 0;
};

/// Whether anything is that of the point nearest to a place, or may fall back on it.
bool needs_nearest(const PointCloud& cloud, const Reductions& reductions) {
    return !cloud.normals.empty() || !cloud.attributes.empty() ||
           (!cloud.colors.empty() && reductions.color == Reduction::Nearest);
}

/// In linear light. Where alpha means something, each colour counts by it: that of a transparent
/// point, which nobody sees, is not mixed into those that are seen.
Rgba8 mean_color(const PointCloud& cloud, std::span<const Index> members) {
    const auto& linear = linear_from_srgb();
    const bool by_alpha = cloud.has_alpha && std::ranges::any_of(members, [&](Index i) {
                              return cloud.colors[i].a != 0;
                          });
    LinearColor sum;
    double weights = 0;
    for (const Index i : members) {
        const Rgba8& c = cloud.colors[i];
        const double weight = by_alpha ? c.a : 1.0;
        weights += weight;
        sum.r += weight * static_cast<double>(linear[c.r]);
        sum.g += weight * static_cast<double>(linear[c.g]);
        sum.b += weight * static_cast<double>(linear[c.b]);
        sum.a += c.a;
    }
    const double n = static_cast<double>(members.size());
    return {srgb_from_linear(sum.r / weights), srgb_from_linear(sum.g / weights),
            srgb_from_linear(sum.b / weights), static_cast<std::uint8_t>(std::lround(sum.a / n))};
}

/// The mean direction; the normal of `fallback` where the directions cancel.
Vec3f mean_normal(const std::vector<Vec3f>& normals, std::span<const Index> members,
                  Index fallback) {
    Vec3d sum = Vec3d::Zero();
    for (const Index i : members) sum += normals[i].cast<double>().normalized();
    constexpr double kCancelled = 1e-12;
    if (!(sum.squaredNorm() > kCancelled)) return normals[fallback];
    return sum.normalized().cast<float>();
}

template <typename T>
bool is_nan(T value) noexcept {
    return value != value;
}

/// Of what is a number, where anything is.
template <typename T>
T mode_of(std::vector<T>& values) {
    const T first = values.front();
    std::erase_if(values, is_nan<T>);
    if (values.empty()) return first;
    std::ranges::sort(values);
    T best = values.front();
    std::size_t best_count = 0;
    for (std::size_t i = 0; i < values.size();) {
        std::size_t j = i;
        while (j < values.size() && values[j] == values[i]) ++j;
        if (j - i > best_count) {
            best = values[i];
            best_count = j - i;
        }
        i = j;
    }
    return best;
}

/// One component of an attribute over a cluster.
template <typename T>
T reduced(const std::vector<T>& values, unsigned components, unsigned component,
          std::span<const Index> members, Index nearest, Reduction reduction,
          std::vector<T>& buffer) {
    const auto value = [&](Index i) {
        return values[static_cast<std::size_t>(i) * components + component];
    };
    switch (reduction) {
        case Reduction::Nearest:
            return value(nearest);
        case Reduction::Mean: {
            double sum = 0;
            std::size_t count = 0;
            for (const Index i : members) {
                if (is_nan(value(i))) continue;
                sum += static_cast<double>(value(i));
                ++count;
            }
            if (count == 0) return value(members.front());
            double mean = sum / static_cast<double>(count);
            if (std::isinf(sum)) {  // perhaps the sum alone is too large
                mean = 0;
                for (const Index i : members)
                    if (!is_nan(value(i)))
                        mean += static_cast<double>(value(i)) / static_cast<double>(count);
            }
            if constexpr (std::is_integral_v<T>)
                return static_cast<T>(std::llround(mean));
            else
                return static_cast<T>(mean);
        }
        case Reduction::Min: {
            T best = value(members.front());
            for (const Index i : members) best = is_nan(best) ? value(i) : std::min(best, value(i));
            return best;
        }
        case Reduction::Max: {
            T best = value(members.front());
            for (const Index i : members) best = is_nan(best) ? value(i) : std::max(best, value(i));
            return best;
        }
        case Reduction::Mode: {
            buffer.clear();
            for (const Index i : members) buffer.push_back(value(i));
            return mode_of(buffer);
        }
    }
    return value(nearest);
}

std::string attribute_names(const PointCloud& cloud) {
    std::string names;
    const auto add = [&](const std::string& name) { names += (names.empty() ? "" : ", ") + name; };
    if (!cloud.normals.empty()) add(kNormal);
    if (!cloud.colors.empty()) add(kColor);
    for (const Attribute& attribute : cloud.attributes) add(attribute.name);
    return names.empty() ? "none" : names;
}

/// The policy of colours or normals that is called by this name; null for another.
Reduction* own_policy(const PointCloud& cloud, std::string_view name, Reductions& reductions) {
    if (name == kNormal && !cloud.normals.empty()) return &reductions.normal;
    if (name == kColor && !cloud.colors.empty()) return &reductions.color;
    return nullptr;
}

}  // namespace

Reductions reductions_for(const PointCloud& cloud, const std::map<std::string, Reduction>& named,
                          Representative kind) {
    Reductions result;
    const bool copies = kind == Representative::Nearest;
    if (copies) result.color = result.normal = Reduction::Nearest;
    for (const Attribute& attribute : cloud.attributes)
        result.attributes.push_back(copies ? Reduction::Nearest : attribute.reduction);
    for (const auto& [name, reduction] : named) {
        if (const Attribute* const attribute = find_attribute(cloud, name)) {
            const auto number = static_cast<std::size_t>(attribute - cloud.attributes.data());
            result.attributes[number] = reduction;
            continue;
        }
        Reduction* const own = own_policy(cloud, name, result);
        if (own == nullptr) {
            throw Error(
                ErrorCode::InvalidArgument,
                "reductions: no attribute " + name + "; the cloud has: " + attribute_names(cloud));
        }
        if (reduction != Reduction::Mean && reduction != Reduction::Nearest)
            throw Error(ErrorCode::InvalidArgument,
                        "reductions: " + name + " by min, max or mode: expected mean or nearest");
        *own = reduction;
    }
    return result;
}

PointCloud merged_cloud(const PointCloud& cloud, std::vector<Vec3f> positions,
                        const MemberLists& lists, std::span<const Index> nearest,
                        const Reductions& reductions, const RunContext& context) {
    const std::size_t count = positions.size();
    PointCloud result;
    result.origin = cloud.origin;
    result.has_alpha = cloud.has_alpha;
    result.double_precision = cloud.double_precision;
    result.positions = std::move(positions);
    if (!cloud.normals.empty()) resize_in_blocks(result.normals, count, context);
    if (!cloud.colors.empty()) resize_in_blocks(result.colors, count, context);
    for (const Attribute& a : cloud.attributes) {
        result.attributes.push_back({a.name,
                                     std::visit(
                                         [&](const auto& values) -> AttributeValues {
                                             return made_in_blocks<std::decay_t<decltype(values)>>(
                                                 count * a.components, context);
                                         },
                                         a.values),
                                     a.components, a.reduction});
    }
    parallel_for_blocks(count, kClustersPerBlock, context, [&](std::size_t begin, std::size_t end) {
        if (!cloud.normals.empty()) {
            for (std::size_t i = begin; i < end; ++i) {
                result.normals[i] = reductions.normal == Reduction::Nearest
                                        ? cloud.normals[nearest[i]]
                                        : mean_normal(cloud.normals, lists.of(i), nearest[i]);
            }
        }
        if (!cloud.colors.empty()) {
            for (std::size_t i = begin; i < end; ++i) {
                result.colors[i] = reductions.color == Reduction::Nearest
                                       ? cloud.colors[nearest[i]]
                                       : mean_color(cloud, lists.of(i));
            }
        }
        for (std::size_t a = 0; a < cloud.attributes.size(); ++a) {
            const Attribute& from = cloud.attributes[a];
            std::visit(
                [&](const auto& values) {
                    using Values = std::decay_t<decltype(values)>;
                    auto& out = std::get<Values>(result.attributes[a].values);
                    Values buffer;
                    for (std::size_t i = begin; i < end; ++i) {
                        for (unsigned c = 0; c < from.components; ++c) {
                            out[i * from.components + c] =
                                reduced(values, from.components, c, lists.of(i), nearest[i],
                                        reductions.attributes[a], buffer);
                        }
                    }
                },
                from.values);
        }
    });
    return result;
}

PointCloud merged_cloud(const PointCloud& cloud, std::vector<Vec3f> positions,
                        const MemberLists& lists,
                        const std::map<std::string, Reduction>& reductions,
                        const RunContext& context) {
    const Reductions of_each = reductions_for(cloud, reductions, Representative::Centroid);
    std::vector<Index> nearest;
    if (needs_nearest(cloud, of_each))
        nearest = nearest_members(cloud.positions, lists, positions, context);
    return merged_cloud(cloud, std::move(positions), lists, nearest, of_each, context);
}

std::vector<Index> nearest_members(std::span<const Vec3f> points, const MemberLists& lists,
                                   std::span<const Vec3f> positions, const RunContext& context) {
    auto nearest = made_in_blocks<std::vector<Index>>(positions.size(), context);
    parallel_for_blocks(nearest.size(), kClustersPerBlock, context,
                        [&](std::size_t begin, std::size_t end) {
                            Gathered gathered(points);
                            for (std::size_t i = begin; i < end; ++i)
                                nearest[i] = gathered.nearest_to(positions[i], lists.of(i)).index;
                        });
    return nearest;
}

PointCloud representatives(const PointCloud& cloud, const MemberLists& clusters,
                           Representative kind, const Reductions& reductions,
                           const RunContext& context) {
    const std::size_t count = clusters.size();
    const bool take_nearest = kind == Representative::Nearest;
    const bool with_nearest = take_nearest || needs_nearest(cloud, reductions);
    auto positions = made_in_blocks<std::vector<Vec3f>>(count, context);
    auto nearest = made_in_blocks<std::vector<Index>>(with_nearest ? count : 0, context);
    parallel_for_blocks(count, kClustersPerBlock, context, [&](std::size_t begin, std::size_t end) {
        Gathered gathered(cloud.positions, clusters.ordered);
        for (std::size_t i = begin; i < end; ++i) {
            const std::span<const Index> members = clusters.of(i);
            const SampleMoments moments = gathered.moments_of(members);
            const Vec3d target = kind == Representative::Surface
                                     ? surface_point(gathered, members, moments)
                                     : moments.centroid;
            positions[i] = target.cast<float>();
            if (!with_nearest) continue;
            const Near near = gathered.nearest_to(positions[i], members);
            nearest[i] = near.index;
            if (take_nearest) positions[i] = near.position;
        }
    });
    return merged_cloud(cloud, std::move(positions), clusters, nearest, reductions, context);
}

PointCloud representatives(const PointCloud& cloud, const Clusters& clusters, Representative kind,
                           const RunContext& context) {
    return representatives(cloud, MemberLists{clusters.members.data(), clusters.offsets}, kind,
                           reductions_for(cloud, {}, kind), context);
}

}  // namespace stipple
