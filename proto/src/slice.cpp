#include "stipple/proto/slice.hpp"

#include "job_cloud.hpp"
#include "json_parts.hpp"
#include "rounding_error.hpp"
#include "slice_levels.hpp"
#include "stipple/error.hpp"
#include "stipple/surface_error.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <string_view>

namespace stipple::proto {

namespace {

constexpr std::uint64_t kMostGlbPoints = 65'536;
constexpr int kMostTries = 12;
constexpr double kCloseEnough = 0.98;  // of a budget of bytes

/// A cloud that may be the answer: a cut, or fewer points of it.
struct Candidate {
    std::shared_ptr<const LevelCut> cut;
    std::optional<PointCloud> trimmed;
    std::vector<std::byte> bytes;
    double step = 0;  ///< of the grid that they are rounded to

    const PointCloud& cloud() const { return trimmed ? *trimmed : cut->cloud; }
};

/// As short as tells it apart, however small: 1e-09, 0.25.
std::string number(double value) {
    return std::isfinite(value) ? Json(value).dump() : std::to_string(value);
}

/// Brings positions that a method moved out of the box of others back to its faces.
void keep_within(PointCloud& cloud, const PointCloud& others) {
    const Aabb box = bounds(others);
    const Vec3f low = (box.min - others.origin).cast<float>(),
                high = (box.max - others.origin).cast<float>();
    for (Vec3f& p : cloud.positions) p = p.cwiseMax(low).cwiseMin(high);
}

/// Labels and the like are not averaged, though tiles give those of 32 bits back as floats.
void keep_whole_numbers(const std::vector<CloudAttribute>& attributes, SimplifyOptions& options) {
    for (const CloudAttribute& attribute : attributes)
        if (!attribute.type.starts_with("float"))
            options.reductions.try_emplace(attribute.name, Reduction::Nearest);
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
          context_(context),
          levels_(pyramid, options, read, context) {}

    Slice run() {
        if (options_.points) return sliced(with_points(*options_.points));
        if (options_.bytes) return sliced(within_bytes(static_cast<double>(*options_.bytes)));
        return sliced(within_error(options_.max_error
                                       ? *options_.max_error
                                       : *options_.max_error_rel *
                                             pyramid_.source.value().bounds.diagonal()));
    }

private:
    // Budgets.

    Candidate with_points(std::uint64_t points) {
        require_room(std::min(points, levels_.most_points(pyramid_.levels.back())));
        Candidate candidate{levels_.level_with(points), {}, {}};
        if (candidate.cut->cloud.size() > points)
            candidate.trimmed = simplified(*candidate.cut, points);
        encode(candidate);
        return candidate;
    }

    /// Tries counts, each by what the two before say of the bytes of a point, and keeps the largest
    /// that fits.
    Candidate within_bytes(double budget) {
        std::optional<Candidate> best;
        const double most = static_cast<double>(std::max<std::uint64_t>(1, most_points()));
        const double aim = (1 + kCloseEnough) / 2 * budget;
        double points = aim / bytes_a_point(budget), fits = 0, too_many = most + 1;
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
            points = got + (aim - bytes) / (std::isfinite(more) && more > 0 ? more : bytes / got);
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
        std::optional<FileError> error;
        bool in_format = true;  // whether the error counts what the format rounds
        for (std::size_t i = 0; i < pyramid_.levels.size(); ++i) {
            const OutputCloud& level = pyramid_.levels[i];
            error = levels_.error_of(level);
            in_format = options_.format == CloudFormat::Ply;
            if (!error || error->max > bound) continue;
            // Of tiles that meet a box, any number of points may lie outside.
            if (levels_.tiled(level) && !options_.box) require_room(levels_.most_points(level));
            Candidate candidate{levels_.read_level(i), {}, {}};
            if (candidate.cloud().empty()) {  // the box may lie between the points of the level
                if (i + 1 < pyramid_.levels.size()) continue;
                levels_.refuse_empty_box();
            }
            require_room(candidate.cloud().size());
            encode(candidate);
            error->max += error_of_step(candidate.step).max;
            in_format = true;
            if (error->max <= bound) return candidate;
        }
        if (levels_.most_points(pyramid_.levels.back()) == 0) levels_.refuse_empty_box();
        throw Error(
            ErrorCode::InvalidArgument,
            "max_error " + number(bound) +
                (!error      ? ": no error was measured here"
                 : in_format ? ": expected at least " + number(error->max) +
                                   ", that of the finest level in this format"
                             : ": expected more than " + number(error->max) +
                                   ", that of the finest level before this format rounds it"));
    }

    /// Of the finest level, and that may be returned.
    std::uint64_t most_points() const {
        return std::min({options_.max_points, levels_.most_points(pyramid_.levels.back()),
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

    PointCloud simplified(const LevelCut& cut, std::uint64_t points) const {
        const PointCloud& cloud = cut.cloud;
        SimplifyOptions options = job_.options.simplification;
        options.points = points;
        if (options.method != Method::Random)
            keep_whole_numbers(pyramid_.levels[cut.level].attributes, options);
        to_frame_of(cloud, options.particles);
        leave_out_missing(cloud, options);
        PointCloud result = simplify(cloud, options, context_);
        if (options_.box) keep_within(result, cloud);
        return result;
    }

    Slice sliced(Candidate&& candidate) const {
        const LevelCut& cut = *candidate.cut;
        const FileError rounding = error_of_step(candidate.step);
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

    void encode(Candidate& candidate) const {
        const PointCloud& cloud = candidate.cloud();
        switch (options_.format) {
            case CloudFormat::Ply:
                candidate.bytes = encode_ply(cloud, {}, context_);
                return;
            case CloudFormat::Draco:
                candidate.bytes = encode_draco(cloud, options_.draco, context_, &candidate.step);
                return;
            case CloudFormat::Glb:
            case CloudFormat::Progressive:  // refused by `validate`, as the next
            case CloudFormat::Copc:
                break;
        }
        const LodTile tile = tile_of(cloud);
        const bool is_place = tile.last == decltype(tile.last){};
        candidate.step = is_place ? 0 : tile.step;  // one place alone is where it was
        candidate.bytes = encode_glb(tile);
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

    const Results& pyramid_;
    const PyramidJob& job_;
    const SliceOptions& options_;
    const RunContext& context_;
    SliceLevels levels_;
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
