// stipple-tile-check: whether a folder of tiles holds what its manifest and tileset say. Every tile
// is decoded: counts, boxes, places. Errors are measured again by a measure that shares no code
// with the one that made them.

#include "program.hpp"
#include "stipple/cleaning.hpp"
#include "stipple/codec.hpp"
#include "stipple/neighbors.hpp"
#include "stipple/proto/pyramid_export.hpp"
#include "stipple/proto/tiles.hpp"
#include "surface_distance.hpp"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

namespace stipple::bench {

namespace {

namespace fs = std::filesystem;
using nlohmann::json;

std::vector<std::byte> bytes_of(const fs::path& file) {
    std::ifstream in(file, std::ios::binary);
    if (!in) throw std::runtime_error(file.string() + ": cannot be read");
    std::vector<std::byte> bytes(fs::file_size(file));
    in.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    return bytes;
}

std::string text_of(const fs::path& file) {
    const std::vector<std::byte> bytes = bytes_of(file);
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// A tile as it decodes, and as the manifest has it.
struct Tile {
    std::string uri;
    LodTile said;
    std::uint64_t bytes;
    PointCloud points;
};

/// Counts what is wrong, and tells the first of each kind.
class Findings {
public:
    void expect(bool holds, const std::string& kind, const std::string& where) {
        if (!holds && wrong_[kind]++ == 0) std::printf("%s: %s\n", kind.c_str(), where.c_str());
    }
    /// @return  how many there are.
    std::size_t print() const {
        std::size_t all = 0;
        for (const auto& [kind, count] : wrong_) {
            std::printf("%zu x %s\n", count, kind.c_str());
            all += count;
        }
        return all;
    }

private:
    std::map<std::string, std::size_t> wrong_;
};

class Check {
public:
    /// @param few_strays  whether strays weigh as most points do.
    Check(fs::path folder, const fs::path& cloud, bool few_strays)
        : folder_(std::move(folder)), few_strays_(few_strays) {
        results_ = proto::results_from_json(text_of(folder_ / "manifest.json"));
        source_ = read_cloud(cloud);
        clean(source_);
        const Aabb& box = results_.source.value().bounds;
        center_ = 0.5 * (box.min + box.max);
        for (const proto::OutputCloud& level : results_.levels) read(level);
    }

    void check_counts() {
        for (std::size_t level = 0; level < results_.levels.size(); ++level) {
            std::uint64_t points = 0;
            for (const Tile& tile : tiles_) {
                if (!is_of(tile, level)) continue;
                points += tile.points.size();
                findings_.expect(tile.points.size() == tile.said.points && !tile.points.empty(),
                                 "a tile has other points than said", tile.uri);
            }
            findings_.expect(points == results_.levels[level].points,
                             "a level has other points than said", std::to_string(level));
        }
    }

    /// Every point of the finest level lies beside one of the source.
    void check_places() {
        const NeighborSearch source(source_.positions);
        for (const Tile& tile : tiles_) {
            if (!is_of(tile, results_.levels.size() - 1)) continue;
            for (const Vec3f& p : tile.points.positions) {
                const Vec3d place = tile.points.origin + p.cast<double>() - source_.origin;
                Neighbor nearest{};
                source.nearest(place.cast<float>(), {&nearest, 1});
                const double rounding = 1e-6 * place.norm();
                const double way = std::sqrt(static_cast<double>(nearest.distance_sq));
                findings_.expect(way <= 0.87 * tile.said.step + rounding,
                                 "a point of the finest level is none of the source", tile.uri);
            }
        }
    }

    void check_tileset() {
        for (std::size_t i = 0; i < tiles_.size(); ++i) by_uri_[tiles_[i].uri] = i;
        const json tileset = json::parse(text_of(folder_ / "tileset.json"));
        walk(tileset["root"], nullptr);
        findings_.expect(seen_ == tiles_.size(), "tiles that the tileset does not name",
                         std::to_string(seen_) + " of " + std::to_string(tiles_.size()));
    }

    void measure(const SurfaceDistanceOptions& options) {
        const SurfaceMeter meter(source_, {}, options);
        std::printf(
            "| level | points | tiles | bits | bytes | said mean | measured | ratio | "
            "tiles by points: rms of ratio - 1 | worst | beyond confidence |\n"
            "|---|---|---|---|---|---|---|---|---|---|---|\n");
        for (std::size_t level = 0; level < results_.levels.size(); ++level) measure(level, meter);
    }

    std::size_t print() const { return findings_.print(); }

private:
    /// Whether the level has the points of a tile: where tiles are additive, those above, too.
    bool is_of(const Tile& tile, std::size_t level) const {
        const auto& job = std::get<proto::PyramidJob>(results_.request.job);
        return tile.said.level == level || (job.options.nested && tile.said.level < level);
    }

    void read(const proto::OutputCloud& level) {
        for (const proto::OutputFile& file : level.files) {
            if (!file.tile) continue;
            const std::string uri = proto::file_name(level, file);
            const std::vector<std::byte> bytes = bytes_of(folder_ / uri);
            // From the tile's own place: from the middle floats may not tell all of its grid.
            LodTile tile = proto::decode_glb(bytes);
            const Vec3d place = center_ + std::exchange(tile.offset, Vec3d::Zero());
            tiles_.push_back({uri, *file.tile, bytes.size(), decode_tile(tile, place)});
        }
    }

    /// The box of a tile of the tileset, grown by what floats round.
    static Aabb box_of(const json& tile) {
        const auto& box = tile["boundingVolume"]["box"];
        const Vec3d middle(box[0], box[1], box[2]), half(box[3], box[7], box[11]);
        const Vec3d grown = half * (1 + 1e-6) + Vec3d::Constant(1e-9);
        return {middle - grown, middle + grown};
    }
    static bool inside(const Vec3d& p, const Aabb& box) {
        return (p.array() >= box.min.array()).all() && (p.array() <= box.max.array()).all();
    }

    void walk(const json& tile, const json* parent) {
        if (parent != nullptr) {
            findings_.expect((*parent)["geometricError"] >= tile["geometricError"],
                             "an error is larger than that above it", tile.dump().substr(0, 200));
        }
        const std::string uri = tile.contains("content") ? tile["content"]["uri"] : json("");
        if (uri.ends_with(".json")) {
            walk(json::parse(text_of(folder_ / uri))["root"], &tile);
            return;
        }
        boxes_.push_back(box_of(tile));
        if (!uri.empty()) {
            ++seen_;
            check_path(tiles_.at(by_uri_.at(uri)));
        }
        if (tile.contains("children"))
            for (const json& child : tile["children"]) walk(child, &tile);
        boxes_.pop_back();
    }

    /// A tile lies in its box and in those above; its mean error is no larger than that above.
    void check_path(const Tile& tile) {
        for (const Vec3f& p : tile.points.positions) {
            const Vec3d place = tile.points.origin - center_ + p.cast<double>();
            findings_.expect(
                std::ranges::all_of(boxes_, [&](const Aabb& box) { return inside(place, box); }),
                "a point lies outside of a box", tile.uri);
        }
        if (!tile.said.parent) return;
        const Tile& above = tiles_.at(*tile.said.parent);
        findings_.expect(above.said.level < tile.said.level, "a parent is no coarser", tile.uri);
        findings_.expect(tile.said.error.mean <= above.said.error.mean,
                         "a mean error is larger than that above it", tile.uri);
    }

    /// Of the points of a cloud.
    struct Room {
        double usual, wide;
    };
    static Room room_of(std::vector<double> areas) {
        std::ranges::sort(areas);
        constexpr double kMuchWider = 8;
        return {areas[areas.size() / 2], kMuchWider * areas[areas.size() * 19 / 20]};
    }

    void measure(std::size_t level, const SurfaceMeter& meter) {
        PointCloud all;
        all.origin = center_;
        std::vector<std::size_t> tile_of;  // by point
        std::size_t bytes = 0, count = 0;
        for (std::size_t t = 0; t < tiles_.size(); ++t) {
            if (!is_of(tiles_[t], level)) continue;
            const Vec3d shift = tiles_[t].points.origin - center_;
            for (const Vec3f& p : tiles_[t].points.positions)
                all.positions.push_back((p.cast<double>() + shift).cast<float>());
            tile_of.resize(all.size(), t);
            bytes += tiles_[t].bytes;
            ++count;
        }
        // As tiles say it: from the surface of a small cloud, from the points of a large one.
        constexpr std::size_t kLarge = 40'000;
        PlaceDistances measured = meter.measure_places(all, source_.size() < kLarge);
        const NeighborSearch nearest(all.positions);
        const Room room = room_of(measured.areas);
        struct Sum {
            double area = 0, distance = 0;
        };
        Sum whole;
        std::map<std::size_t, Sum> tiles;
        for (std::size_t i = 0; i < measured.places.size(); ++i) {
            Neighbor found{};
            nearest.nearest((measured.places[i] - center_).cast<float>(), {&found, 1});
            if (few_strays_ && measured.areas[i] > room.wide) {
                measured.areas[i] = room.usual;
                measured.distances[i] =
                    std::min(measured.distances[i], std::sqrt(double{found.distance_sq}));
            }
            const std::size_t tile = tile_of[found.index];
            // What tiles of other levels say is of those.
            Sum others;
            for (Sum* const sum :
                 {&whole, tiles_[tile].said.level == level ? &tiles[tile] : &others}) {
                sum->area += measured.areas[i];
                sum->distance += measured.areas[i] * measured.distances[i];
            }
        }
        double squares = 0, worst = 0;
        std::size_t beyond = 0;
        for (const auto& [t, sum] : tiles) {
            const TileError& said = tiles_[t].said.error;
            const double ratio = said.mean / (sum.distance / sum.area);
            squares += (ratio - 1) * (ratio - 1) / static_cast<double>(tiles.size());
            worst = std::max(worst, std::abs(ratio - 1));
            if (std::abs(said.mean - sum.distance / sum.area) > said.mean_confidence) ++beyond;
        }
        const double mean = whole.distance / whole.area;
        const double said = results_.levels[level].decoded.value().error.mean;
        std::printf("| %zu | %zu | %zu | %u | %zu | %.4g | %.4g | %.4f | %.4f | %.4f | %zu |\n",
                    level, all.size(), count, tiles_[tile_of[0]].said.bits, bytes, said, mean,
                    said / mean, std::sqrt(squares), worst, beyond);
        std::fflush(stdout);
    }

    fs::path folder_;
    bool few_strays_;
    proto::Results results_;
    PointCloud source_;
    Vec3d center_;
    std::vector<Tile> tiles_;
    std::map<std::string, std::size_t> by_uri_;
    std::vector<Aabb> boxes_;  ///< of the tile that is looked at, and of those above
    std::size_t seen_ = 0;
    Findings findings_;
};

int run(const fs::path& folder, const fs::path& cloud, const SurfaceDistanceOptions& options,
        bool few_strays) {
    Check check(folder, cloud, few_strays);
    check.check_counts();
    check.check_places();
    check.check_tileset();
    if (options.samples > 0) check.measure(options);
    return check.print() == 0 ? 0 : 1;
}

}  // namespace

}  // namespace stipple::bench

int main(int argc, char** argv) {
    using namespace stipple::bench;
    std::filesystem::path folder, cloud;
    SurfaceDistanceOptions options{.samples = 400'000};
    bool few_strays = false;
    CLI::App app("Whether a folder of tiles holds what its manifest and tileset say.",
                 "stipple-tile-check");
    app.add_option("FOLDER", folder, "what `stipple pyramid CLOUD FOLDER --formats glb` wrote")
        ->required();
    app.add_option("CLOUD", cloud, "what it was made of")->required();
    app.add_option("--samples", options.samples,
                   "points of the cloud to measure at, at most; 0: no errors are measured")
        ->check(at_least(0))
        ->capture_default_str();
    app.add_option("--starts", options.starts,
                   "not one walk to the surface, but the nearest of its places found by so many")
        ->check(at_least(0))
        ->capture_default_str();
    app.add_flag("--few-strays", few_strays,
                 "as tiles say it: points with eight times the room of nineteen in twenty weigh as "
                 "most do, and are no farther than the nearest decoded point");
    app.add_option("--threads", options.threads, "0: all")->check(at_least(0));
    return run_program(app, argc, argv, [&] { return run(folder, cloud, options, few_strays); });
}
