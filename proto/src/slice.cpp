#include "stipple/proto/slice.hpp"

#include "draco_rounding.hpp"
#include "job_cloud.hpp"
#include "json_parts.hpp"
#include "stipple/error.hpp"
#include "stipple/proto/tiles.hpp"
#include "stipple/surface_error.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <string_view>

namespace stipple::proto {

namespace {

constexpr std::uint64_t kMostGlbPoints = 65'536;
constexpr int kMostTries = 12;
constexpr double kCloseEnough = 0.98;   // of a budget of bytes
constexpr std::uint64_t kMostRead = 4;  // points, for each that may be returned

struct Distances {
    double mean = 0, max = 0;
};

/// Points of a level that lie in the box, and how far that level is from the source.
struct Cut {
    std::size_t level = 0;
    PointCloud cloud;
    std::optional<Distances> error;
};

/// A cloud that may be the answer: a cut, or fewer points of it.
struct Candidate {
    std::shared_ptr<const Cut> cut;
    std::optional<PointCloud> trimmed;
    std::vector<std::byte> bytes;

    const PointCloud& cloud() const { return trimmed ? *trimmed : cut->cloud; }
};

/// As short as tells it apart, however small: 1e-09, 0.25.
std::string number(double value) {
    return std::isfinite(value) ? Json(value).dump() : std::to_string(value);
}

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

/// Brings positions that a method moved out of the box of others back to its faces.
void keep_within(PointCloud& cloud, const PointCloud& others) {
    const Aabb box = bounds(others);
    const Vec3f low = (box.min - others.origin).cast<float>(),
                high = (box.max - others.origin).cast<float>();
    for (Vec3f& p : cloud.positions) p = p.cwiseMax(low).cwiseMin(high);
}

/// What the options say of attributes that the cloud lacks, as tiles may, is left out.
void leave_out_missing(const PointCloud& cloud, SimplifyOptions& options) {
    const auto is_missing = [&cloud](const std::string& name) {
        return find_attribute(cloud, name) == nullptr;
    };
    const auto is_named = [&](const auto& entry) { return is_missing(entry.first); };
    std::erase_if(options.reductions, is_named);
    std::erase_if(options.iterative.attribute_weights, is_named);
    if (cloud.colors.empty()) options.iterative.color_weight = 0;
    std::erase_if(options.particles.regions, [&](const DensityRegion& region) {
        const auto* const scalar = std::get_if<DensityRegion::Scalar>(&region.where);
        return scalar != nullptr && is_missing(scalar->attribute);
    });
}

class Slicer {
public:
    Slicer(const Results& pyramid, const SliceOptions& options, const FileReader& read,
           const RunContext& context)
        : pyramid_(pyramid),
          job_(std::get<PyramidJob>(pyramid.request.job)),
          options_(options),
          read_(read),
          context_(context),
          cuts_(pyramid.levels.size()) {
        const Aabb& source = pyramid.source.value().bounds;
        center_ = 0.5 * (source.min + source.max);
        origin_ = pyramid.levels.front().origin.value_or(center_);
    }

    Slice run() {
        if (options_.points) return sliced(with_points(*options_.points));
        if (options_.bytes) return sliced(within_bytes(static_cast<double>(*options_.bytes)));
        return sliced(within_error(options_.max_error
                                       ? *options_.max_error
                                       : *options_.max_error_rel *
                                             pyramid_.source.value().bounds.diagonal()));
    }

private:
    // Levels.

    /// Whether to read the level from tiles.
    bool tiled(const OutputCloud& level) const {
        const bool tiles = std::ranges::any_of(
            level.files, [](const OutputFile& f) { return f.tile.has_value(); });
        return tiles && (find_ply(level) == nullptr || (options_.box && keep_attributes(level)));
    }

    /// Whether tiles have the attributes as they are that they are asked to have: all but those
    /// that a float does not hold.
    bool keep_attributes(const OutputCloud& level) const {
        const auto is_wide = [](const CloudAttribute& attribute) {
            return attribute.type == "int32" || attribute.type == "uint32" ||
                   attribute.type == "float64";
        };
        return !job_.tiles.attributes || std::ranges::none_of(level.attributes, is_wide);
    }

    bool in_box(const OutputFile& file) const {
        if (!file.tile) return false;
        if (!options_.box) return true;
        return meet(*options_.box, pyramid_.source.value().bounds) &&
               meet(reach_of(*file.tile), box_of(*file.tile));
    }

    /// Of the points of a tile.
    Aabb box_of(const LodTile& tile) const {
        const Vec3d low = center_ + tile.offset;
        return {low, low + tile.step * Vec3d(tile.last[0], tile.last[1], tile.last[2])};
    }

    /// The box with what rounding may have taken across its faces: half a step, and what floats
    /// round. Outside of the source's box there was nothing.
    Aabb reach_of(const LodTile& tile) const {
        const Aabb &box = *options_.box, &source = pyramid_.source.value().bounds;
        const Aabb points = box_of(tile);
        double largest = 0;  // of the numbers that were rounded to floats
        for (const Vec3d& from : {center_, origin_})
            for (const Vec3d& corner : {points.min, points.max})
                largest = std::max(largest, (corner - from).cwiseAbs().maxCoeff());
        constexpr double kFloat = std::numeric_limits<float>::epsilon(),
                         kFar = std::numeric_limits<double>::infinity();
        const double off = 0.5 * tile.step + kFloat * largest;
        Aabb reach{box.min.array() - off, box.max.array() + off};
        for (int axis = 0; axis < 3; ++axis) {
            if (box.min[axis] <= source.min[axis]) reach.min[axis] = -kFar;
            if (box.max[axis] >= source.max[axis]) reach.max[axis] = kFar;
        }
        return reach;
    }

    /// Calls visit(file) for the tiles in the box that are the level: those of coarser ones, too,
    /// where tiles are additive.
    template <typename Visit>
    void for_tiles(const OutputCloud& level, Visit&& visit) const {
        for (const OutputCloud& other : pyramid_.levels) {
            const bool above = job_.options.nested && other.level < level.level;
            if (!above && other.level != level.level) continue;
            for (const OutputFile& file : other.files)
                if (in_box(file)) visit(file);
        }
    }

    /// The most points that the level can have in the box.
    std::uint64_t most_points(const OutputCloud& level) const {
        if (!tiled(level)) return level.points;
        std::uint64_t points = 0;
        for_tiles(level, [&](const OutputFile& file) { points += file.tile->points; });
        return points;
    }

    /// Of a point in memory, with the attributes that it is read with.
    std::uint64_t bytes_of_point(const OutputCloud& level) const {
        const bool all = !tiled(level) || job_.tiles.attributes;
        std::uint64_t bytes = sizeof(Vec3f);
        for (const CloudAttribute& attribute : level.attributes)
            if (all || attribute.name == "normal" || attribute.name == "color")
                bytes += std::uint64_t{attribute.components} * size_of_type(attribute.type);
        return bytes;
    }

    /// @throws Error(TooLarge) where the level has more points here than are read.
    void require_readable(const OutputCloud& level) const {
        const std::uint64_t points = most_points(level), bytes = bytes_of_point(level);
        const std::uint64_t most =
            std::min(kMostRead * options_.max_points, options_.max_read_bytes / bytes);
        if (points <= most) return;
        throw Error(ErrorCode::TooLarge,
                    "level " + std::to_string(level.level) + " has " + std::to_string(points) +
                        " points of " + std::to_string(bytes) + " bytes here: at most " +
                        std::to_string(most) + " are read; ask for fewer points, or a smaller box");
    }

    std::shared_ptr<const Cut> read_level(std::size_t number) const {
        const OutputCloud& level = pyramid_.levels[number];
        context_.throw_if_stopped();
        require_readable(level);
        Cut cut{number, {}, error_of(level)};
        if (tiled(level)) {
            read_tiles(level, cut.cloud);
        } else if (const OutputFile* const ply = find_ply(level)) {
            cut.cloud = read_ply(*ply, level.points);
            if (options_.box)
                cut.cloud = points_in(std::move(cut.cloud), *options_.box, *options_.box);
        } else {
            throw Error(ErrorCode::InvalidArgument,
                        "this pyramid has neither PLY levels nor tiles: make it with one of the "
                        "formats ply and glb to cut clouds from it");
        }
        return std::make_shared<const Cut>(std::move(cut));
    }

    /// Bytes of another format are not decoded: Draco's needs its own process.
    PointCloud read_ply(const OutputFile& file, std::uint64_t points) const {
        const std::vector<std::byte> bytes = read_(file);
        if (detect_format(bytes) != CloudFormat::Ply)
            throw Error(ErrorCode::MalformedInput,
                        file.sha256 + ": expected PLY, as the manifest says");
        PointCloud cloud = decode_cloud(bytes, DecodeLimits{.max_points = points}, context_);
        require_points(file, cloud.size(), points);
        return cloud;
    }

    static void require_points(const OutputFile& file, std::uint64_t found,
                               std::uint64_t expected) {
        if (found == expected) return;
        throw Error(ErrorCode::MalformedInput, file.sha256 + ": expected " +
                                                   std::to_string(expected) +
                                                   " points, as the manifest says");
    }

    /// In the frame of the source.
    void read_tiles(const OutputCloud& level, PointCloud& cloud) const {
        cloud.origin = origin_;
        for_tiles(level, [&](const OutputFile& file) {
            context_.throw_if_stopped();
            LodTile tile = decode_glb(read_(file));
            require_points(file, tile.points, file.tile->points);
            tile.offset += center_ - origin_;
            PointCloud part = decode_tile(tile, origin_);
            if (options_.box)
                part = points_in(std::move(part), *options_.box, reach_of(*file.tile));
            append(cloud, std::move(part));
        });
    }

    /// That of the level, or of its tiles here: where they are read, and where it was not measured.
    /// Where tiles are additive a level has none in places to which it adds nothing: that of all
    /// its tiles then.
    std::optional<Distances> error_of(const OutputCloud& level) const {
        if (level.error && !tiled(level))
            return Distances{level.error->error.mean(), level.error->error.max()};
        if (job_.options.nested && level.decoded)
            return Distances{level.decoded->error.mean, level.decoded->error.max};
        Distances error;
        double points = 0;
        for (const OutputFile& file : level.files) {
            if (!in_box(file)) continue;
            const double share = static_cast<double>(file.tile->points);
            error.mean += share * file.tile->error.mean;
            error.max = std::max(error.max, file.tile->error.max);
            points += share;
        }
        if (points == 0) return std::nullopt;
        error.mean /= points;
        return error;
    }

    /// The coarsest level with so many points in the box, or the finest.
    std::shared_ptr<const Cut> level_with(std::uint64_t points) {
        const std::size_t finest = pyramid_.levels.size() - 1;
        for (std::size_t i = 0;; ++i) {
            if (i < finest && most_points(pyramid_.levels[i]) < points) continue;
            if (!cuts_[i]) cuts_[i] = read_level(i);
            if (cuts_[i]->cloud.size() < points && i < finest) continue;
            if (cuts_[i]->cloud.empty())
                throw Error(ErrorCode::NotFound, "no point lies in the box");
            return cuts_[i];
        }
    }

    // Budgets.

    Candidate with_points(std::uint64_t points) {
        require_room(std::min(points, most_points(pyramid_.levels.back())));
        Candidate candidate{level_with(points), {}, {}};
        const PointCloud& all = candidate.cut->cloud;
        if (all.size() > points) candidate.trimmed = simplified(all, points);
        candidate.bytes = encoded(candidate.cloud());
        return candidate;
    }

    /// Tries counts, each by what the two before say of the bytes of a point, and keeps the largest
    /// that fits.
    Candidate within_bytes(double budget) {
        std::optional<Candidate> best;
        const double most = static_cast<double>(std::max<std::uint64_t>(1, most_points()));
        double points = budget / bytes_a_point(budget), fits = 0, too_many = most + 1;
        double points_before = 0, bytes_before = 0;
        Candidate tried;
        for (int i = 0; i < kMostTries && too_many - fits > 1; ++i) {
            const bool at_last = i + 1 == kMostTries && !best;
            points = at_last ? 1 : std::clamp(std::floor(points), fits + 1, too_many - 1);
            tried = with_points(static_cast<std::uint64_t>(points));
            const auto bytes = static_cast<double>(tried.bytes.size());
            const auto got = static_cast<double>(tried.cloud().size());
            const bool all = got < points;
            (bytes <= budget ? fits : too_many) = points;
            const double more = (bytes - bytes_before) / (got - points_before);
            points = got + ((1 + kCloseEnough) / 2 * budget - bytes) /
                               (std::isfinite(more) && more > 0 ? more : bytes / got);
            points_before = got, bytes_before = bytes;
            if (bytes > budget) continue;
            best = std::move(tried);
            if (all || bytes >= kCloseEnough * budget) break;
        }
        if (best) return std::move(*best);
        throw Error(ErrorCode::InvalidArgument,
                    "bytes " + std::to_string(*options_.bytes) + ": expected at least " +
                        std::to_string(tried.bytes.size()) + ", for " +
                        std::to_string(tried.cloud().size()) +
                        (tried.cloud().size() == 1 ? " point" : " points"));
    }

    /// What the files of the coarsest level with so many bytes take for a point, where there are
    /// some in the format; else a guess.
    double bytes_a_point(double budget) const {
        double taken = 16;
        for (const OutputCloud& level : pyramid_.levels) {
            double bytes = 0;
            for (const OutputFile& file : level.files)
                if (file.format == options_.format) bytes += static_cast<double>(file.bytes);
            if (bytes > 0) taken = bytes / static_cast<double>(level.points);
            if (bytes >= budget) break;
        }
        return taken;
    }

    Candidate within_error(double bound) {
        std::optional<Distances> error;
        for (std::size_t i = 0; i < pyramid_.levels.size(); ++i) {
            const OutputCloud& level = pyramid_.levels[i];
            error = error_of(level);
            if (!error || error->max > bound) continue;
            if (tiled(level)) require_room(most_points(level));
            Candidate candidate{read_level(i), {}, {}};
            if (candidate.cloud().empty()) {  // the box may lie between the points of the level
                if (i + 1 < pyramid_.levels.size()) continue;
                throw Error(ErrorCode::NotFound, "no point lies in the box");
            }
            require_room(candidate.cloud().size());
            candidate.bytes = encoded(candidate.cloud());
            error->max += rounding_of(candidate).max;
            if (error->max <= bound) return candidate;
        }
        if (most_points(pyramid_.levels.back()) == 0)
            throw Error(ErrorCode::NotFound, "no point lies in the box");
        throw Error(ErrorCode::InvalidArgument,
                    "max_error " + number(bound) +
                        (error ? ": expected at least " + number(error->max) +
                                     ", that of the finest level in this format"
                               : ": no error was measured here"));
    }

    /// Of the finest level, and that may be returned.
    std::uint64_t most_points() const {
        return std::min({options_.max_points, most_points(pyramid_.levels.back()),
                         options_.format == CloudFormat::Glb ? kMostGlbPoints : UINT64_MAX});
    }

    void require_room(std::uint64_t points) const {
        if (points > options_.max_points)
            throw Error(ErrorCode::TooLarge,
                        std::to_string(points) + " points: a slice has at most " +
                            std::to_string(options_.max_points) +
                            "; fetch the level's own files, listed in the manifest");
        if (options_.format == CloudFormat::Glb && points > kMostGlbPoints)
            throw Error(ErrorCode::InvalidArgument, std::to_string(points) +
                                                        " points: a glb has at most " +
                                                        std::to_string(kMostGlbPoints) +
                                                        "; ask for ply or drc, or use the tileset");
    }

    // Clouds.

    PointCloud simplified(const PointCloud& cloud, std::uint64_t points) const {
        SimplifyOptions options = job_.options.simplification;
        options.points = points;
        to_frame_of(cloud, options.particles);
        leave_out_missing(cloud, options);
        PointCloud result = simplify(cloud, options, context_);
        if (options_.box) keep_within(result, cloud);
        return result;
    }

    Slice sliced(Candidate&& candidate) const {
        const Cut& cut = *candidate.cut;
        const Distances rounding = rounding_of(candidate);
        Slice slice{.bytes = std::move(candidate.bytes),
                    .points = candidate.cloud().size(),
                    .level = pyramid_.levels[cut.level].level,
                    .origin = candidate.cloud().origin,
                    .error_mean = {},
                    .error_max = {}};
        if (!cut.error) return slice;
        slice.error_mean = cut.error->mean + rounding.mean;
        slice.error_max = cut.error->max + rounding.max;
        if (candidate.trimmed) {
            const SurfaceError added = estimate_error(cut.cloud, *candidate.trimmed, context_);
            *slice.error_mean += added.mean();
            *slice.error_max += added.max();
        }
        return slice;
    }

    std::vector<std::byte> encoded(const PointCloud& cloud) const {
        switch (options_.format) {
            case CloudFormat::Ply:
                return encode_ply(cloud, {}, context_);
            case CloudFormat::Draco:
                return encode_draco(cloud, options_.draco, context_);
            case CloudFormat::Glb:
            case CloudFormat::Progressive:  // refused by `validate`, as the next
            case CloudFormat::Copc:
                break;
        }
        return encode_glb(tile_of(cloud));
    }

    /// All of a cloud as one tile, in steps so long that it is not cut.
    LodTile tile_of(const PointCloud& cloud) const {
        const auto tiles_of = [&](std::optional<double> precision) {
            LodTiler tiler(cloud,
                           {.precision = precision, .attributes = true, .errors = LodErrors::Rough},
                           context_);
            std::vector<LodTile> tiles = tiler.add_level(cloud, true, context_);
            tiles.at(0).offset += tiler.center();
            return tiles;
        };
        std::vector<LodTile> tiles = tiles_of(std::nullopt);
        constexpr double kSteps = 65'000;
        if (tiles.size() > 1) tiles = tiles_of(0.5 * longest_side(cloud) / kSteps);
        return std::move(tiles.at(0));
    }

    static double longest_side(const PointCloud& cloud) {
        const Aabb box = bounds(cloud);
        return (box.max - box.min).maxCoeff();
    }

    /// What rounding adds, at most: steps are the longest that the format may take.
    Distances rounding_of(const Candidate& candidate) const {
        double step = 0;
        if (options_.format == CloudFormat::Glb) {
            const LodTile tile = decode_glb(candidate.bytes);
            const bool is_place = tile.last == decltype(tile.last){};
            if (!is_place) step = tile.step;  // one place alone is where it was
        } else if (options_.format == CloudFormat::Draco) {
            step = longest_step(options_.draco, longest_side(candidate.cloud()));
        }
        const FileError added = error_of_step(step);
        return {added.mean, added.max};
    }

    const Results& pyramid_;
    const PyramidJob& job_;
    const SliceOptions& options_;
    const FileReader& read_;
    const RunContext& context_;
    Vec3d center_;  ///< of the source's box: tiles are relative to it
    Vec3d origin_;  ///< of the source's positions
    std::vector<std::shared_ptr<const Cut>> cuts_;  ///< of the levels that were read
};

}  // namespace

void validate(const SliceOptions& options) {
    const auto refuse = [](const std::string& what) {
        throw Error(ErrorCode::InvalidArgument, what);
    };
    if (int{options.points.has_value()} + options.bytes.has_value() +
            options.max_error.has_value() + options.max_error_rel.has_value() !=
        1) {
        refuse("expected exactly one of points, bytes and max_error");
    }
    if (options.points == 0) refuse("points 0: expected at least 1");
    if (options.format == CloudFormat::Glb && options.points > kMostGlbPoints)
        refuse(std::to_string(*options.points) + " points: a glb has at most " +
               std::to_string(kMostGlbPoints) + "; ask for ply or drc, or use the tileset");
    if (options.bytes == 0) refuse("bytes 0: expected at least 1");
    for (const auto& bound : {options.max_error, options.max_error_rel})
        if (bound && !(*bound > 0 && std::isfinite(*bound)))
            refuse("max_error " + number(*bound) + ": expected a length above 0");
    if (options.format == CloudFormat::Progressive || options.format == CloudFormat::Copc)
        refuse("format " + std::string(to_string(options.format)) + ": expected ply, drc or glb");
    if (options.box &&
        (options.box->empty() || !options.box->min.allFinite() || !options.box->max.allFinite())) {
        refuse("box: expected six finite numbers, x0 <= x1, y0 <= y1 and z0 <= z1");
    }
}

/// What differs from the defaults.
std::string draco_query(const DracoEncodeOptions& options) {
    const Json defaults = draco_json({}), draco = draco_json(options);
    std::string query;
    for (const auto& [name, value] : draco.items()) {
        if (defaults.value(name, Json()) == value) continue;
        query += '&' + name + '=' + (value.is_string() ? value.get<std::string>() : value.dump());
    }
    return query;
}

std::string slice_query(const SliceOptions& options) {
    std::string query = "format=" + std::string(to_string(options.format));
    if (options.points) query += "&points=" + std::to_string(*options.points);
    if (options.bytes) query += "&bytes=" + std::to_string(*options.bytes);
    if (options.max_error) query += "&max_error=" + Json(*options.max_error).dump();
    if (options.max_error_rel)
        query += "&max_error=" + percent_text(*options.max_error_rel) + "25";  // %25: %
    if (options.box) {
        const auto& [low, high] = *options.box;
        const Json numbers = {low.x(), low.y(), low.z(), high.x(), high.y(), high.z()};
        const std::string list = numbers.dump();
        query += "&box=" + list.substr(1, list.size() - 2);
    }
    if (options.format == CloudFormat::Draco) query += draco_query(options.draco);
    return query;
}

Slice slice_pyramid(const Results& pyramid, const SliceOptions& options, const FileReader& read,
                    const RunContext& context) {
    validate(options);
    if (!pyramid.complete || pyramid.levels.empty() || !pyramid.source ||
        !std::holds_alternative<PyramidJob>(pyramid.request.job)) {
        throw Error(ErrorCode::InvalidArgument, "expected a finished pyramid");
    }
    return Slicer(pyramid, options, read, context).run();
}

}  // namespace stipple::proto
