#include "slice_levels.hpp"

#include "json_reader.hpp"
#include "rounding_error.hpp"
#include "stipple/codec.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <string_view>
#include <utility>

namespace stipple::proto {

namespace {

constexpr std::uint64_t kMostRead = 4;  // points, for each that may be returned

/// Of `float64`: 8.
std::uint64_t size_of_type(std::string_view name) noexcept {
    if (name.ends_with("64")) return 8;
    if (name.ends_with("32")) return 4;
    return name.ends_with("16") ? 2 : 1;
}

const OutputFile* find_ply(const OutputCloud& level) {
    const auto found = std::ranges::find(level.files, CloudFormat::Ply, &OutputFile::format);
    return found == level.files.end() ? nullptr : &*found;
}

void append(PointCloud& to, PointCloud&& from) {
    if (to.empty()) {
        to = std::move(from);
        return;
    }
    const auto add = [](auto& all, auto& more) { all.insert(all.end(), more.begin(), more.end()); };
    add(to.positions, from.positions);
    add(to.normals, from.normals);
    add(to.colors, from.colors);
    for (std::size_t i = 0; i < to.attributes.size(); ++i) {
        std::visit(
            [&](auto& all) {
                add(all, std::get<std::decay_t<decltype(all)>>(from.attributes.at(i).values));
            },
            to.attributes[i].values);
    }
}

bool meet(const Aabb& a, const Aabb& b) {
    return (a.min.array() <= b.max.array()).all() && (b.min.array() <= a.max.array()).all();
}

/// The float next to a place in the box, relative to the origin: in the box, too, if floats are
/// that close.
Vec3f float_in(const Aabb& box, const Vec3d& place, const Vec3d& origin) {
    constexpr float kFar = std::numeric_limits<float>::infinity();
    Vec3f p = (place - origin).cast<float>();
    for (int axis = 0; axis < 3; ++axis) {
        const double at = origin[axis] + static_cast<double>(p[axis]);
        if (at < box.min[axis]) p[axis] = std::nextafter(p[axis], kFar);
        if (at > box.max[axis]) p[axis] = std::nextafter(p[axis], -kFar);
    }
    return p;
}

/// The points in the box, and those that may lie in it though they are rounded: these are moved
/// onto its faces.
/// @param reach  the box with what rounding may have taken across its faces.
PointCloud points_in(PointCloud&& cloud, const Aabb& box, const Aabb& reach) {
    std::vector<Index> inside;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const Vec3d p = cloud.origin + cloud.positions[i].cast<double>();
        if (!((p.array() >= reach.min.array()).all() && (p.array() <= reach.max.array()).all()))
            continue;
        inside.push_back(static_cast<Index>(i));
        const Vec3d nearest = p.cwiseMax(box.min).cwiseMin(box.max);
        if (p != nearest) cloud.positions[i] = float_in(box, nearest, cloud.origin);
    }
    return inside.size() == cloud.size() ? std::move(cloud) : subset(cloud, inside);
}

void require_points(const OutputFile& file, std::uint64_t found, std::uint64_t expected) {
    if (found == expected) return;
    throw Error(ErrorCode::MalformedInput, file.sha256 + ": expected " + std::to_string(expected) +
                                               " points, as the manifest says");
}

}  // namespace

SliceLevels::SliceLevels(const Results& pyramid, const SliceOptions& options,
                         const FileReader& read, const RunContext& context)
    : pyramid_(pyramid),
      job_(std::get<PyramidJob>(pyramid.request.job)),
      options_(options),
      read_(read),
      context_(context),
      cuts_(pyramid.levels.size()) {
    for (const OutputCloud& level : pyramid.levels) {
        if (tiled(level) || find_ply(level) != nullptr) continue;
        throw Error(ErrorCode::InvalidArgument,
                    "this pyramid has neither PLY levels nor tiles: make it with one of the "
                    "formats ply and glb to cut clouds from it");
    }
    const Aabb& source = pyramid.source.value().bounds;
    center_ = 0.5 * (source.min + source.max);
    origin_ = pyramid.levels.front().origin.value_or(center_);
    if (options.box) middle_of_most_ = middle_of_tiles(pyramid.levels.back()).value_or(center_);
}

/// Of tiles with about as many points each: what a few that lie far off hardly move.
std::optional<Vec3d> SliceLevels::middle_of_tiles(const OutputCloud& level) const {
    std::vector<Vec3d> middles;
    for (const OutputFile& file : level.files) {
        if (!file.tile) continue;
        const Aabb box = box_of(*file.tile);
        middles.push_back(0.5 * (box.min + box.max));
    }
    if (middles.empty()) return std::nullopt;
    const auto median = middles.begin() + static_cast<std::ptrdiff_t>(middles.size() / 2);
    Vec3d middle;
    for (int axis = 0; axis < 3; ++axis) {
        std::ranges::nth_element(middles, median, {}, [axis](const Vec3d& m) { return m[axis]; });
        middle[axis] = (*median)[axis];
    }
    return middle;
}

bool SliceLevels::tiled(const OutputCloud& level) const {
    const bool tiles =
        std::ranges::any_of(level.files, [](const OutputFile& f) { return f.tile.has_value(); });
    return tiles && (find_ply(level) == nullptr || (options_.box && keep_attributes(level)));
}

/// Whether tiles have the attributes as they are that they are asked to have: all but those
/// that a float does not hold.
bool SliceLevels::keep_attributes(const OutputCloud& level) const {
    const auto is_wide = [](const CloudAttribute& attribute) {
        return attribute.type == "int32" || attribute.type == "uint32" ||
               attribute.type == "float64";
    };
    return !job_.tiles.attributes || std::ranges::none_of(level.attributes, is_wide);
}

bool SliceLevels::in_box(const OutputFile& file) const {
    if (!file.tile) return false;
    if (!options_.box) return true;
    return meet(*options_.box, pyramid_.source.value().bounds) &&
           meet(reach_of(*file.tile), box_of(*file.tile));
}

/// Of the points of a tile.
Aabb SliceLevels::box_of(const LodTile& tile) const {
    const Vec3d low = center_ + tile.offset;
    return {low, low + tile.step * Vec3d(tile.last[0], tile.last[1], tile.last[2])};
}

/// The box with what rounding may have taken across its faces: half a step, and what floats
/// round. Outside of the source's box there was nothing.
Aabb SliceLevels::reach_of(const LodTile& tile) const {
    const Aabb &box = *options_.box, &source = pyramid_.source.value().bounds;
    const Aabb points = box_of(tile);
    // Tiles are rounded in a frame about the middle, or about most points where a few lie far off:
    // these have the bits of the grid, and their frame is no wider than 64 of it.
    constexpr double kWidest = 64;
    constexpr unsigned kBitsOfFloat = 24;
    const unsigned bits = job_.tiles.precision ? kBitsOfFloat : job_.tiles.position_bits;
    const double around_most = kWidest * std::ldexp(tile.step, static_cast<int>(bits));
    Vec3d largest = Vec3d::Zero();  // of the numbers that were rounded to floats
    for (const Vec3d& corner : {points.min, points.max}) {
        const Vec3d from_most =
            ((corner - middle_of_most_).cwiseAbs().array() + around_most).matrix();
        largest = largest.cwiseMax((corner - origin_).cwiseAbs())
                      .cwiseMax((corner - center_).cwiseAbs().cwiseMin(from_most));
    }
    constexpr double kFar = std::numeric_limits<double>::infinity(),
                     kFloat = 0x1p-23;  // twice: to the tile's frame, and to the cloud's
    const Vec3d off = (0.5 * tile.step + kFloat * largest.array()).matrix();
    Aabb reach{box.min - off, box.max + off};
    for (int axis = 0; axis < 3; ++axis) {
        if (box.min[axis] <= source.min[axis]) reach.min[axis] = -kFar;
        if (box.max[axis] >= source.max[axis]) reach.max[axis] = kFar;
    }
    return reach;
}

/// Calls visit(file) for the tiles in the box that are the level: those of coarser ones, too,
/// where tiles are additive.
template <typename Visit>
void SliceLevels::for_tiles(const OutputCloud& level, Visit&& visit) const {
    for (const OutputCloud& other : pyramid_.levels) {
        const bool above = job_.options.nested && other.level < level.level;
        if (!above && other.level != level.level) continue;
        for (const OutputFile& file : other.files)
            if (in_box(file)) visit(file);
    }
}

std::uint64_t SliceLevels::most_points(const OutputCloud& level) const {
    if (!tiled(level)) return level.points;
    std::uint64_t points = 0;
    for_tiles(level, [&](const OutputFile& file) { points += file.tile->points; });
    return points;
}

/// Of a point in memory, with the attributes that it is read with.
std::uint64_t SliceLevels::bytes_of_point(const OutputCloud& level) const {
    const bool all = !tiled(level) || job_.tiles.attributes;
    std::uint64_t bytes = sizeof(Vec3f);
    for (const CloudAttribute& attribute : level.attributes)
        if (all || attribute.name == "normal" || attribute.name == "color")
            bytes += std::uint64_t{attribute.components} * size_of_type(attribute.type);
    return bytes;
}

/// @throws Error(TooLarge) where the level has more points here than are read.
void SliceLevels::require_readable(const OutputCloud& level) const {
    const std::uint64_t points = most_points(level), bytes = bytes_of_point(level);
    const std::uint64_t most =
        std::min(kMostRead * options_.max_points, options_.max_read_bytes / bytes);
    if (points <= most) return;
    throw Error(ErrorCode::TooLarge,
                "level " + std::to_string(level.level) + " has " + std::to_string(points) +
                    " points of " + std::to_string(bytes) + " bytes here: at most " +
                    std::to_string(most) + " are read; ask for fewer points, or a smaller box");
}

std::shared_ptr<const LevelCut> SliceLevels::read_level(std::size_t number) const {
    const OutputCloud& level = pyramid_.levels[number];
    context_.throw_if_stopped();
    require_readable(level);
    LevelCut cut{number, {}, error_of(level)};
    if (tiled(level)) {
        read_tiles(level, cut.cloud);
    } else {
        cut.cloud = read_ply(*find_ply(level), level.points);
        if (options_.box) cut.cloud = points_in(std::move(cut.cloud), *options_.box, *options_.box);
    }
    return std::make_shared<const LevelCut>(std::move(cut));
}

/// Bytes of another format are not decoded: Draco's needs its own process.
PointCloud SliceLevels::read_ply(const OutputFile& file, std::uint64_t points) const {
    const std::vector<std::byte> bytes = read_(file);
    if (detect_format(bytes) != CloudFormat::Ply)
        throw Error(ErrorCode::MalformedInput,
                    file.sha256 + ": expected PLY, as the manifest says");
    const DecodeLimits limits{.max_points = points, .max_attributes = DecodeLimits::kAnyAttributes};
    PointCloud cloud = decode_cloud(bytes, limits, context_);
    require_points(file, cloud.size(), points);
    return cloud;
}

/// In the frame of the source.
void SliceLevels::read_tiles(const OutputCloud& level, PointCloud& cloud) const {
    cloud.origin = origin_;
    for_tiles(level, [&](const OutputFile& file) {
        context_.throw_if_stopped();
        LodTile tile = decode_glb(read_(file));
        require_points(file, tile.points, file.tile->points);
        tile.offset += center_ - origin_;
        PointCloud part = decode_tile(tile, origin_);
        if (options_.box) part = points_in(std::move(part), *options_.box, reach_of(*file.tile));
        append(cloud, std::move(part));
    });
}

/// That of the level, or of its tiles here: where they are read, and where it was not measured.
/// Where tiles are additive a level has none in places to which it adds nothing: that of all
/// its tiles then.
std::optional<FileError> SliceLevels::error_of(const OutputCloud& level) const {
    if (level.error && !tiled(level))
        return FileError{level.error->error.mean(), level.error->error.max()};
    if (job_.options.nested && level.decoded)
        return FileError{level.decoded->error.mean, level.decoded->error.max};
    FileError error;
    double points = 0, longest_step = 0;
    for (const OutputFile& file : level.files) {
        if (!in_box(file)) continue;
        longest_step = std::max(longest_step, file.tile->step);
        const double share = static_cast<double>(file.tile->points);
        error.mean += share * file.tile->error.mean;
        error.max = std::max(error.max, file.tile->error.max);
        points += share;
    }
    if (points == 0) return std::nullopt;
    error.mean /= points;
    if (!level.error) return error;
    // What the level was measured to have before its points were rounded: of a noisy cloud a tile
    // tells how far the noise is from its own surface.
    const FileError rounding = error_of_step(longest_step);
    return FileError{std::min(error.mean, level.error->error.mean() + rounding.mean),
                     std::min(error.max, level.error->error.max() + rounding.max)};
}

void SliceLevels::refuse_empty_box() const {
    if (!options_.box) throw Error(ErrorCode::NotFound, "the pyramid has no points");
    const auto text = [](const Vec3d& place) {
        return Json{place.x(), place.y(), place.z()}.dump();
    };
    const Aabb& all = pyramid_.source.value().bounds;
    throw Error(ErrorCode::NotFound, "no point lies in the box " + text(options_.box->min) +
                                         " to " + text(options_.box->max) + ": the cloud spans " +
                                         text(all.min) + " to " + text(all.max));
}

std::shared_ptr<const LevelCut> SliceLevels::level_with(std::uint64_t points) {
    const std::size_t finest = pyramid_.levels.size() - 1;
    for (std::size_t i = 0;; ++i) {
        if (i < finest && most_points(pyramid_.levels[i]) < points) continue;
        if (!cuts_[i]) cuts_[i] = read_level(i);
        if (cuts_[i]->cloud.size() < points && i < finest) continue;
        if (cuts_[i]->cloud.empty()) refuse_empty_box();
        return cuts_[i];
    }
}

}  // namespace stipple::proto
