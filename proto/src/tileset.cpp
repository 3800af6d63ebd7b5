#include "stipple/proto/tiles.hpp"

#include "json_reader.hpp"
#include "names.hpp"
#include "stipple/error.hpp"
#include "stipple/globe.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

// Follows: OGC 22-025r4, 3D Tiles 1.1.

namespace stipple::proto {

namespace {

constexpr std::array<Named<TilesetError>, 4> kErrorNames{{{TilesetError::Max, "max"},
                                                          {TilesetError::Mean, "avg"},
                                                          {TilesetError::P99, "p99"},
                                                          {TilesetError::Spacing, "spacing"}}};

/// A tile and what lies below it.
struct Node {
    const OutputFile* file;
    const LodTile* tile;
    std::vector<std::size_t> children;
    std::size_t below = 0;  ///< tiles of the subtree, with this one
    Vec3d low, high;        ///< of all of them
    double error = 0;
};

/// The geometric error of a tile, without those below.
double own_error(const LodTile& tile, bool is_leaf, TilesetError error) {
    // Above 0, with which some viewers draw nothing.
    const double least = 1e-3 * tile.step;
    switch (error) {
        case TilesetError::Mean:
            return std::max(tile.error.mean, least);
        case TilesetError::P99:
            return std::max(tile.error.p99, least);
        case TilesetError::Spacing:
            return std::max(tile.spacing, least);
        case TilesetError::Max:
            break;
    }
    const double gap = std::max(tile.spacing, tile.step);
    return is_leaf ? gap : std::max(gap, tile.error.max);
}

std::vector<Node> nodes_of(const Results& results, const TilesetOptions& options) {
    std::vector<Node> nodes;
    for (const OutputCloud& level : results.levels) {
        for (const OutputFile& file : level.files) {
            if (!file.tile) continue;
            const LodTile& tile = *file.tile;
            // Half a step around: nothing that a viewer rounds lies outside, and no side is zero.
            const Vec3d last(tile.last[0], tile.last[1], tile.last[2]);
            const Vec3d half = Vec3d::Constant(0.5 * tile.step);
            nodes.push_back(
                {&file, &tile, {}, 1, tile.offset - half, tile.offset + tile.step * last + half});
        }
    }
    // Parents stand before their children.
    for (std::size_t i = nodes.size(); i-- > 0;) {
        Node& node = nodes[i];
        node.error =
            options.error_scale * own_error(*node.tile, node.children.empty(), options.error);
        std::ranges::reverse(node.children);
        for (const std::size_t c : node.children) node.error = std::max(node.error, nodes[c].error);
        if (!node.tile->parent) continue;
        Node& parent = nodes.at(*node.tile->parent);
        parent.children.push_back(i);
        parent.below += node.below;
        parent.low = parent.low.cwiseMin(node.low);
        parent.high = parent.high.cwiseMax(node.high);
    }
    return nodes;
}

Json box_json(const Vec3d& low, const Vec3d& high) {
    const Vec3d center = 0.5 * (low + high), half = 0.5 * (high - low);
    return {{"box",
             {center.x(), center.y(), center.z(), half.x(), 0., 0., 0., half.y(), 0., 0., 0.,
              half.z()}}};
}

Json extras_json(const Node& node) {
    const LodTile& tile = *node.tile;
    return {{"level", tile.level},
            {"points", tile.points},
            {"bits", tile.bits},
            {"bytes", node.file->bytes},
            {"error",
             {{"mean", tile.error.mean},
              {"max", tile.error.max},
              {"p99", tile.error.p99},
              {"meanConfidence", tile.error.mean_confidence},
              {"samples", tile.error.samples}}},
            {"spacing", tile.spacing},
            {"coverRadius", tile.cover_radius}};
}

/// What `metadata_json` says, in the terms of the 3D Metadata Specification.
Json schema_json() {
    const auto scalar = [](const char* type, const char* description) {
        return Json{{"type", "SCALAR"}, {"componentType", type}, {"description", description}};
    };
    const Json length = {{"type", "SCALAR"}, {"componentType", "FLOAT64"}};
    return {{"id", "stipple"},
            {"classes",
             {{"lod",
               {{"properties",
                 {{"deltaAvg", scalar("FLOAT64", "Mean distance from the input's surface")},
                  {"deltaMax", length},
                  {"deltaP99", length},
                  {"spacing", length},
                  {"coverRadius", length},
                  {"points", scalar("UINT32", "Points of the tile")},
                  {"bits", scalar("UINT8", "Per axis, for the longest side of the input")},
                  {"method", {{"type", "STRING"}}}}}}}}}};
}

/// The same as `extras_json`, for viewers that style by metadata.
Json metadata_json(const Node& node, std::string_view method) {
    const LodTile& tile = *node.tile;
    return {{"class", "lod"},
            {"properties",
             {{"deltaAvg", tile.error.mean},
              {"deltaMax", tile.error.max},
              {"deltaP99", tile.error.p99},
              {"spacing", tile.spacing},
              {"coverRadius", tile.cover_radius},
              {"points", tile.points},
              {"bits", tile.bits},
              {"method", method}}}};
}

/// What a tile says whether it has content or not.
Json head_json(const Vec3d& low, const Vec3d& high, double error, const char* refine) {
    return {{"boundingVolume", box_json(low, high)}, {"geometricError", error}, {"refine", refine}};
}

/// Writes trees of tiles, each file with no more than so many.
class Writer {
public:
    using Tops = std::span<const std::size_t>;

    Writer(const std::vector<Node>& nodes, const TilesetOptions& options, const char* refine,
           std::string_view method)
        : nodes_(nodes),
          max_tiles_(options.max_tiles),
          query_(tileset_query(options)),
          refine_(refine),
          method_(method) {}

    /// A file whose root is `root`, and those that it names.
    void write(const std::string& name, double geometric_error, Json&& root) {
        write_one(name, geometric_error, std::move(root));
        while (!open_.empty()) {
            auto [tops, json] = std::move(open_.back());
            open_.pop_back();
            const double error = json["geometricError"];
            write_one(name_of(tops), error,
                      tops.size() == 1 ? subtree(tops[0]) : with_all(std::move(json), tops));
        }
    }

    /// A tile with several trees below it: here where all fit, else in further files.
    Json with_trees(Json&& root, Tops tops) {
        std::size_t tiles = 0;
        for (const std::size_t top : tops) tiles += nodes_[top].below;
        if (tiles <= max_tiles_) return with_all(std::move(root), tops);
        refer(root, tops);
        return std::move(root);
    }

    /// The tiles from `top` on, as deep as whole levels fit.
    Json subtree(std::size_t top) {
        std::vector<std::size_t> levels{1};
        for (std::vector<std::size_t> at{top}; !at.empty();) {
            std::vector<std::size_t> next;
            for (const std::size_t i : at)
                next.insert(next.end(), nodes_[i].children.begin(), nodes_[i].children.end());
            levels.push_back(levels.back() + next.size());
            at = std::move(next);
        }
        const auto fits = std::ranges::upper_bound(levels, max_tiles_);
        const auto depth = static_cast<std::size_t>(fits - levels.begin());
        return tile_json(top, nodes_[top].below <= max_tiles_ ? nodes_.size() : depth);
    }

    std::vector<TilesetFile> take() { return std::move(files_); }

private:
    /// A file still to be written: of one tree, or of several beside each other.
    struct Open {
        std::vector<std::size_t> tops;
        Json head;  ///< of the tile that stands for them
    };

    void write_one(const std::string& name, double geometric_error, Json&& root) {
        const Json json = {{"asset", {{"version", "1.1"}, {"generator", "stipple"}}},
                           {"schema", schema_json()},
                           {"geometricError", geometric_error},
                           {"root", std::move(root)}};
        files_.push_back({name, to_text(json)});
    }

    static std::string name_of(Tops tops) {
        return "tileset-" + std::to_string(tops.front()) + ".json";
    }

    Json head_of(const Node& node) const {
        return head_json(node.low, node.high, node.error, refine_);
    }

    /// @param depth  levels that stand in this file, this one counted.
    Json tile_json(std::size_t i, std::size_t depth) {
        const Node& node = nodes_[i];
        Json json = head_of(node);
        const bool is_inlined = node.file->href.starts_with("data:");
        json["content"] = {{"uri", is_inlined ? node.file->href : node.file->sha256 + ".glb"}};
        json["metadata"] = metadata_json(node, method_);
        json["extras"] = extras_json(node);
        if (depth == 1) {
            refer(json, node.children);
        } else {
            for (const std::size_t c : node.children)
                json["children"].push_back(tile_json(c, depth - 1));
        }
        return json;
    }

    Json with_all(Json&& root, Tops tops) {
        for (const std::size_t top : tops)
            root["children"].push_back(tile_json(top, nodes_.size()));
        return std::move(root);
    }

    /// Names the files of the trees below a tile: as many side by side in one as fit.
    void refer(Json& parent, Tops tops) {
        // What stands for several has the box and the error of their parent, so that it is refined
        // whenever that one is: it has nothing to show itself.
        const Json head = {{"boundingVolume", parent["boundingVolume"]},
                           {"geometricError", parent["geometricError"]},
                           {"refine", refine_}};
        while (!tops.empty()) {
            std::size_t count = 1, tiles = nodes_[tops[0]].below;
            while (count < tops.size() && (tiles += nodes_[tops[count]].below) <= max_tiles_)
                ++count;
            const Tops together = tops.first(count);
            open_.push_back(
                {{together.begin(), together.end()}, count == 1 ? head_of(nodes_[tops[0]]) : head});
            Json json = open_.back().head;
            json["content"] = {{"uri", name_of(together) + query_}};
            parent["children"].push_back(std::move(json));
            tops = tops.subspan(count);
        }
    }

    const std::vector<Node>& nodes_;
    std::size_t max_tiles_;
    std::string query_;  ///< of files that are named
    const char* refine_;
    std::string_view method_;
    std::vector<TilesetFile> files_;
    std::vector<Open> open_;
};

/// From the tiles' coordinates, relative to the middle of the source's box. On the globe it is
/// exact at the middle of most points: that of the box may lie far off all but a stray one.
Json transform_json(const Results& results) {
    Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
    const Aabb& box = results.source.value().bounds;
    const Vec3d center = 0.5 * (box.min + box.max);
    m.topRightCorner<3, 1>() = center;
    const auto& job = std::get<PyramidJob>(results.request.job);
    if (job.epsg) m = globe_frame(*job.epsg, results.source->middle.value_or(center)) * m;
    if (job.transform) m = Eigen::Map<const Eigen::Matrix4d>(job.transform->data()) * m;
    return std::vector<double>(m.data(), m.data() + m.size());
}

}  // namespace

std::string_view to_string(TilesetError error) noexcept {
    return name_of(kErrorNames, error);
}

TilesetError tileset_error_from_name(std::string_view name) {
    try {
        return by_name(kErrorNames, name);
    } catch (const Error& error) {
        throw Error(error.code(), std::string("error ") + error.what());
    }
}

void validate(const TilesetOptions& options) {
    if (options.max_tiles == 0)
        throw Error(ErrorCode::InvalidArgument, "max_tiles 0: expected at least 1");
    const double scale = options.error_scale;
    if (scale >= TilesetOptions::kLeastScale && scale <= TilesetOptions::kMostScale) return;
    const std::string value = std::isfinite(scale) ? Json(scale).dump() : std::to_string(scale);
    throw Error(ErrorCode::InvalidArgument, "errorScale " + value + ": expected 1e-6..1e6");
}

std::string tileset_query(const TilesetOptions& options) {
    std::string query;
    if (options.error != TilesetError::Max)
        query = "error=" + std::string(to_string(options.error));
    if (options.error_scale != 1)
        query +=
            (query.empty() ? "errorScale=" : "&errorScale=") + Json(options.error_scale).dump();
    return query.empty() ? query : "?" + query;
}

std::vector<TilesetFile> tileset_files(const Results& results, const TilesetOptions& options) {
    validate(options);
    const std::vector<Node> nodes = nodes_of(results, options);
    if (nodes.empty()) return {};
    std::vector<std::size_t> tops;
    for (std::size_t i = 0; i < nodes.size(); ++i)
        if (!nodes[i].tile->parent) tops.push_back(i);

    Vec3d low = nodes[tops[0]].low, high = nodes[tops[0]].high;
    double error = 0;
    for (const std::size_t top : tops) {
        low = low.cwiseMin(nodes[top].low);
        high = high.cwiseMax(nodes[top].high);
        error = std::max(error, nodes[top].error);
    }
    // Viewers ask for the root only where this is large on their screen.
    const double diagonal = std::max((high - low).norm(), error);

    const bool adds = std::get<PyramidJob>(results.request.job).options.nested;
    const char* const refine = adds ? "ADD" : "REPLACE";
    const std::string_view method = to_string(method_of(results.request).value());
    Writer writer(nodes, options, refine, method);
    Json root;
    if (tops.size() == 1) {
        root = writer.subtree(tops[0]);
    } else {
        root = writer.with_trees(head_json(low, high, diagonal, refine), tops);
    }
    root["transform"] = transform_json(results);
    writer.write("tileset.json", diagonal, std::move(root));
    return writer.take();
}

}  // namespace stipple::proto
