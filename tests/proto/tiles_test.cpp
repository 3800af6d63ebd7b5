#include "stipple/proto/tiles.hpp"

#include "documents.hpp"
#include "stipple/lod_pyramid.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <functional>
#include <nlohmann/json.hpp>
#include <set>

namespace stipple::proto {
namespace {

using nlohmann::json;

/// A pyramid as a job reports it, with tiles of at most `max_points`.
Results results_of(const PointCloud& cloud, std::vector<std::uint64_t> sizes,
                   std::uint32_t max_points, bool adds = false) {
    PyramidJob job;
    job.options.sizes = std::move(sizes);
    job.options.nested = adds;
    if (adds) job.options.simplification.method = Method::Iterative;
    job.tiles.max_points = max_points;
    job.tiles.additive = adds;
    Results results{.request = {std::string(64, 'a'), job},
                    .source = CloudStatistics{},
                    .levels = {},
                    .complete = true,
                    .cost = {}};
    results.source->bounds = bounds(cloud);
    results.source->middle = middle_of_most(cloud);
    LodTiler tiler(cloud, job.tiles);
    std::size_t number = 0;
    build_lod_pyramid(cloud, job.options, [&](LodLevel&& level) {
        OutputCloud& made = results.levels.emplace_back();
        made.level = level.level;
        for (LodTile& tile : tiler.add_level(level.cloud, level.cloud.size() == cloud.size())) {
            const std::string name = "tile" + std::to_string(number++);
            made.files.push_back(
                {CloudFormat::Glb, encode_glb(tile).size(), name, name + ".glb", std::move(tile)});
        }
    });
    return results;
}

std::map<std::string, json> parsed(const std::vector<TilesetFile>& files) {
    std::map<std::string, json> documents;
    for (const TilesetFile& file : files) documents[file.name] = json::parse(file.json);
    return documents;
}

/// Calls `visit(tile, parent or null)` for every tile of a tileset, in all its files.
void walk(const std::map<std::string, json>& files, const json& tile, const json* parent,
          const std::function<void(const json&, const json*)>& visit) {
    visit(tile, parent);
    if (tile.contains("content")) {
        const std::string uri = tile["content"]["uri"];
        if (files.contains(uri)) walk(files, files.at(uri)["root"], &tile, visit);
    }
    if (tile.contains("children"))
        for (const json& child : tile["children"]) walk(files, child, &tile, visit);
}

bool inside(const json& child, const json& parent) {
    const auto& c = child["boundingVolume"]["box"];
    const auto& p = parent["boundingVolume"]["box"];
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const double middle = std::abs(c[axis].get<double>() - p[axis].get<double>());
        const double half = p[3 + 4 * axis].get<double>() - c[3 + 4 * axis].get<double>();
        if (middle > half + 1e-12) return false;
    }
    return true;
}

TEST(Glb, ComesBackAsTheTileThatItWas) {
    const PointCloud cloud = test::with_attributes(test::sphere(500));
    const LodTile tile = LodTiler(cloud, {.attributes = true}).add_level(cloud, true).front();
    const std::vector<std::byte> glb = encode_glb(tile);
    const LodTile back = decode_glb(glb);
    EXPECT_EQ(back.points, tile.points);
    EXPECT_EQ(back.step, tile.step);
    EXPECT_EQ(back.offset, tile.offset);
    EXPECT_EQ(back.last, tile.last);
    ASSERT_EQ(back.streams.size(), tile.streams.size());
    const PointCloud one = decode_tile(tile), other = decode_tile(back);
    EXPECT_EQ(one.positions, other.positions);
    EXPECT_EQ(one.normals, other.normals);
    EXPECT_EQ(one.colors, other.colors);
    EXPECT_EQ(one.attributes.size(), other.attributes.size());
}

TEST(Glb, SaysWhatStandsForValuesThatAreNotFinite) {
    PointCloud cloud = test::sphere(50);
    std::vector<float> some(cloud.size(), 1.5F);
    for (const bool lacking : {false, true}) {
        if (lacking) some[7] = std::numeric_limits<float>::quiet_NaN();
        cloud.attributes = {{"some value", some, 1, Reduction::Mean}};
        const std::vector<std::byte> glb =
            encode_glb(LodTiler(cloud, {.attributes = true}).add_level(cloud, true).front());
        const std::string_view text(reinterpret_cast<const char*>(glb.data()), glb.size());
        EXPECT_EQ(text.find("EXT_structural_metadata") != text.npos, lacking);
        EXPECT_EQ(text.find(R"("noData":-3.4028234663852886e+38)") != text.npos, lacking);
        const PointCloud back = decode_tile(decode_glb(glb));
        const auto& values = std::get<std::vector<float>>(back.attributes.front().values);
        EXPECT_EQ(std::ranges::count_if(values, [](float v) { return std::isnan(v); }), lacking);
        EXPECT_EQ(std::ranges::count(values, 1.5F), lacking ? 49 : 50);
    }
}

TEST(Glb, SaysWhatWasTakenOffNumbersFarFromZero) {
    PointCloud cloud = test::sphere(50);
    std::vector<double> times(cloud.size());
    for (std::size_t i = 0; i < times.size(); ++i) times[i] = 1.3e9 + 0.25 * static_cast<double>(i);
    cloud.attributes = {{"gps_time", times, 1, Reduction::Mean}};
    const std::vector<std::byte> glb =
        encode_glb(LodTiler(cloud, {.attributes = true}).add_level(cloud, true).front());
    const std::string_view text(reinterpret_cast<const char*>(glb.data()), glb.size());
    EXPECT_NE(text.find(R"("offset":1300000000.0)"), text.npos);
    EXPECT_EQ(text.find("noData"), text.npos);
    const PointCloud back = decode_tile(decode_glb(glb));
    std::vector<double> values = std::get<std::vector<double>>(back.attributes.front().values);
    std::ranges::sort(values);
    EXPECT_EQ(values, times);
}

TEST(Glb, ThatIsCutOffIsRefused) {
    const PointCloud cloud = test::sphere(50);
    const std::vector<std::byte> glb =
        encode_glb(LodTiler(cloud, {}).add_level(cloud, true).front());
    for (std::size_t length = 0; length < glb.size(); ++length)
        EXPECT_THROW(decode_glb(std::span(glb).first(length)), Error) << length;
}

TEST(Tileset, NamesEveryTileOnceWithItsChildrenInsideAndNoLargerErrors) {
    const Results results = results_of(test::sphere(20'000), {500, 5'000, 20'000}, 1'000);
    const auto files = parsed(tileset_files(results));
    ASSERT_EQ(files.size(), 1U);
    const json& root = files.at("tileset.json")["root"];
    std::set<std::string> uris;
    walk(files, root, nullptr, [&](const json& tile, const json* parent) {
        EXPECT_TRUE(uris.insert(tile["content"]["uri"]).second);
        EXPECT_EQ(tile["refine"], "REPLACE");
        const json& extras = tile["extras"];
        const double error = tile["geometricError"];
        if (tile.contains("children")) {
            EXPECT_GE(error, extras["error"]["max"].get<double>());
            EXPECT_GE(error, extras["spacing"].get<double>());
        } else {
            EXPECT_EQ(error, extras["spacing"]);
        }
        if (parent == nullptr) return;
        EXPECT_TRUE(inside(tile, *parent)) << tile["content"];
        EXPECT_LE(error, (*parent)["geometricError"].get<double>());
    });
    std::size_t all = 0;
    for (const OutputCloud& level : results.levels) all += level.files.size();
    EXPECT_EQ(uris.size(), all);
    const json& box = root["boundingVolume"]["box"];
    const Vec3d half(box[3], box[7], box[11]);
    EXPECT_NEAR(files.at("tileset.json")["geometricError"], 2 * half.norm(), 1e-12);
    EXPECT_GT(half.minCoeff(), 0.99);  // the unit sphere, and no more than a step around it
    EXPECT_LT(half.maxCoeff(), 1.2);
}

TEST(Tileset, TellsTheErrorThatIsAskedFor) {
    const Results results = results_of(test::sphere(20'000), {500, 5'000, 20'000}, 1'000);
    const auto measured = [](const json& tile, TilesetError error) -> double {
        const json& extras = tile["extras"];
        if (error == TilesetError::Spacing) return extras["spacing"];
        return extras["error"][error == TilesetError::Mean ? "mean" : "p99"];
    };
    for (const TilesetError error :
         {TilesetError::Mean, TilesetError::P99, TilesetError::Spacing}) {
        for (const double scale : {0.25, 1.0, 3.0}) {
            const auto files =
                parsed(tileset_files(results, {.error = error, .error_scale = scale}));
            const json& whole = files.at("tileset.json");
            walk(files, whole["root"], nullptr, [&](const json& tile, const json* parent) {
                double expected = scale * measured(tile, error);
                if (tile.contains("children"))
                    for (const json& child : tile["children"])
                        expected = std::max(expected, child["geometricError"].get<double>());
                EXPECT_GE(tile["geometricError"], expected);
                EXPECT_GT(tile["geometricError"], 0.0);
                const double step = results.levels[tile["extras"]["level"].get<std::size_t>()]
                                        .files.front()
                                        .tile->step;
                EXPECT_LE(tile["geometricError"], std::max(expected, 1e-3 * scale * step) + 1e-12);
                if (parent == nullptr) return;
                EXPECT_LE(tile["geometricError"], (*parent)["geometricError"]);
            });
            const json& box = whole["root"]["boundingVolume"]["box"];
            EXPECT_GE(whole["geometricError"].get<double>(),
                      2 * Vec3d(box[3], box[7], box[11]).norm() - 1e-12);
        }
    }
    EXPECT_EQ(tileset_files(results, {.error = TilesetError::Max}).front().json,
              tileset_files(results).front().json);
    for (const double wrong : {0.0, -1.0, 1e7, std::nan("")})
        EXPECT_THROW(tileset_files(results, {.error_scale = wrong}), Error) << wrong;
}

TEST(Tileset, OfAnotherErrorCarriesItOnToTheFilesThatItNames) {
    const Results results = results_of(test::sphere(20'000), {500, 5'000, 20'000}, 1'000);
    const TilesetOptions options{.max_tiles = 5, .error = TilesetError::Mean, .error_scale = 0.5};
    EXPECT_EQ(tileset_query(options), "?error=avg&errorScale=0.5");
    EXPECT_EQ(tileset_query({.error_scale = 2}), "?errorScale=2.0");
    EXPECT_THROW(validate(TilesetOptions{.max_tiles = 0}), Error);
    EXPECT_EQ(tileset_query({}), "");
    std::size_t named = 0;
    for (const TilesetFile& file : tileset_files(results, options)) {
        const std::string query = ".json?error=avg&errorScale=0.5\"";
        for (std::size_t at = 0; (at = file.json.find(".json", at)) != std::string::npos; ++at) {
            EXPECT_EQ(file.json.substr(at, query.size()), query);
            ++named;
        }
        EXPECT_EQ(file.json.find(".glb?"), std::string::npos);
    }
    EXPECT_GT(named, 0U);
}

TEST(Tileset, TellsItsFiguresAsMetadataThatFitsTheSchemaOfItsFile) {
    const Results results = results_of(test::sphere(20'000), {500, 5'000, 20'000}, 1'000);
    const auto files = parsed(tileset_files(results, {.max_tiles = 5}));
    EXPECT_GT(files.size(), 1U);
    for (const auto& [name, file] : files) {
        const json& known = file["schema"]["classes"]["lod"]["properties"];
        EXPECT_EQ(known.size(), 8U) << name;
        const std::function<void(const json&)> check = [&](const json& tile) {
            if (tile.contains("extras")) {
                const json& extras = tile["extras"];
                const json& metadata = tile["metadata"];
                EXPECT_EQ(metadata["class"], "lod");
                const json& said = metadata["properties"];
                EXPECT_EQ(said.size(), known.size());
                for (const auto& [property, value] : said.items())
                    EXPECT_TRUE(known.contains(property)) << property;
                EXPECT_EQ(said["deltaAvg"], extras["error"]["mean"]);
                EXPECT_EQ(said["deltaMax"], extras["error"]["max"]);
                EXPECT_EQ(said["deltaP99"], extras["error"]["p99"]);
                for (const char* const same : {"spacing", "coverRadius", "points", "bits"})
                    EXPECT_EQ(said[same], extras[same]);
                EXPECT_EQ(said["method"], to_string(PyramidJob{}.options.simplification.method));
            }
            if (tile.contains("children"))
                for (const json& child : tile["children"]) check(child);
        };
        check(file["root"]);
    }
}

TEST(Tileset, OfAdditiveTilesSaysSoInEveryFile) {
    const Results results = results_of(test::sphere(10'000), {500, 2'500, 10'000}, 1'000, true);
    std::uint64_t points = 0;
    const auto files = parsed(tileset_files(results, {.max_tiles = 5}));
    EXPECT_GT(files.size(), 1U);
    walk(files, files.at("tileset.json")["root"], nullptr,
         [&](const json& tile, const json* parent) {
             EXPECT_EQ(tile["refine"], "ADD");
             EXPECT_TRUE(parent == nullptr || inside(tile, *parent));
             if (tile.contains("extras")) points += tile["extras"]["points"].get<std::uint64_t>();
         });
    EXPECT_EQ(points, 10'000U);
}

TEST(Tileset, OfManyTilesGoesOnInFilesOfItsOwn) {
    const Results results = results_of(test::sphere(20'000), {500, 5'000, 20'000}, 1'000);
    const auto whole = parsed(tileset_files(results)),
               parts = parsed(tileset_files(results, {.max_tiles = 10}));
    EXPECT_GT(parts.size(), 5U);
    const auto tiles = [](const std::map<std::string, json>& files) {
        std::map<std::string, double> errors;
        walk(files, files.at("tileset.json")["root"], nullptr,
             [&](const json& tile, const json* parent) {
                 if (tile.contains("extras"))
                     errors[tile["content"]["uri"]] = tile["geometricError"];
                 EXPECT_TRUE(parent == nullptr || inside(tile, *parent));
             });
        return errors;
    };
    EXPECT_EQ(tiles(parts), tiles(whole));
}

/// One tile with so many below it.
Results broad_tree(std::uint32_t tiles) {
    Results results = results_of(test::sphere(1), {1}, 1);
    for (std::uint32_t i = 0; i < tiles; ++i) {
        OutputFile file = results.levels[0].files[0];
        file.tile->parent = 0;
        results.levels[0].files.push_back(std::move(file));
    }
    return results;
}

TEST(Tileset, OfManySiblingsHasFewFiles) {
    const auto files = parsed(tileset_files(broad_tree(20'000)));
    EXPECT_EQ(files.size(), 5U);
    const json& root = files.at("tileset.json")["root"];
    std::size_t tiles = 0;
    walk(files, root, nullptr, [&](const json& tile, const json* parent) {
        tiles += tile.contains("extras") ? 1 : 0;
        if (parent == nullptr || tile.contains("extras")) return;
        // With nothing to show it is to be refined whenever its parent is.
        EXPECT_EQ(tile["boundingVolume"], (*parent)["boundingVolume"]);
        EXPECT_EQ(tile["geometricError"], (*parent)["geometricError"]);
    });
    EXPECT_EQ(tiles, 20'001U);
}

TEST(Tileset, OfManyFilesTakesNoStackForEach) {
    constexpr std::uint32_t kTiles = 50'000;
    const Results results = broad_tree(kTiles);
    EXPECT_EQ(tileset_files(results, {.max_tiles = 1}).size(), kTiles + 1);
}

TEST(Tileset, WhoseCoarsestLevelIsCutHasNoLargerFilesForThat) {
    const Results results = results_of(test::sphere(4'000), {2'000, 4'000}, 500);
    constexpr std::size_t kMost = 4;
    const auto files = parsed(tileset_files(results, {.max_tiles = kMost}));
    EXPECT_GT(files.size(), 4U);
    std::size_t tiles = 0;
    for (const auto& [name, file] : files) {
        std::size_t here = 0;
        walk({}, file["root"], nullptr,
             [&](const json& tile, const json*) { here += tile.contains("extras") ? 1 : 0; });
        EXPECT_LE(here, kMost) << name;
        tiles += here;
    }
    EXPECT_EQ(tiles, results.levels[0].files.size() + results.levels[1].files.size());
}

TEST(Tileset, OfOnePointHasABoxAndErrorsAboveZero) {
    PointCloud cloud;
    cloud.positions = {{1, 2, 3}};
    const auto files = parsed(tileset_files(results_of(cloud, {1}, 1'000)));
    const json& tileset = files.at("tileset.json");
    EXPECT_GT(tileset["geometricError"], 0);
    EXPECT_GT(tileset["root"]["geometricError"], 0);
    for (const std::size_t half : {3, 7, 11})
        EXPECT_GT(tileset["root"]["boundingVolume"]["box"][half], 0);
}

TEST(Tileset, WhoseCoarsestLevelIsCutHasARootWithoutContent) {
    const auto files = parsed(tileset_files(results_of(test::sphere(4'000), {4'000}, 1'000)));
    const json& root = files.at("tileset.json")["root"];
    EXPECT_FALSE(root.contains("content"));
    EXPECT_EQ(root["children"].size(), 4U);
    for (const json& child : root["children"]) EXPECT_TRUE(inside(child, root));
}

TEST(Tileset, StandsWhereTheFileAndItsTransformSay) {
    PointCloud cloud = test::sphere(100);
    cloud.origin = Vec3d(4e5, 5e6, 100);
    Results results = results_of(cloud, {100}, 1'000);
    const auto place = [&] {
        const json root = parsed(tileset_files(results)).at("tileset.json")["root"];
        return Vec3d(root["transform"][12], root["transform"][13], root["transform"][14]);
    };
    EXPECT_LT((place() - cloud.origin).norm(), 0.1);
    // A quarter turn around z, then 7 up.
    std::get<PyramidJob>(results.request.job).transform = {0, 1, 0, 0, -1, 0, 0, 0,
                                                           0, 0, 1, 0, 0,  0, 7, 1};
    EXPECT_LT((place() - Vec3d(-5e6, 4e5, 107)).norm(), 0.1);
}

TEST(Tileset, StandsOnTheGlobeWhereItsSystemSays) {
    PointCloud cloud = test::sphere(100);
    cloud.origin = Vec3d(300'000, 5'500'000, 50);
    Results results = results_of(cloud, {100}, 1'000);
    std::get<PyramidJob>(results.request.job).epsg = 32733;
    const json root = parsed(tileset_files(results)).at("tileset.json")["root"];
    const auto& m = root["transform"];
    const Vec3d place(m[12], m[13], m[14]), up(m[8], m[9], m[10]);
    EXPECT_LT((place - Vec3d(4730326.4165, 1060415.2879, -4131075.7569)).norm(), 0.1);
    EXPECT_GT(up.dot(place.normalized()), 0.99);
}

TEST(Tileset, StandsOnTheGlobeThoughAPointIsFarOff) {
    PointCloud cloud = test::sphere(2'000);
    cloud.origin = Vec3d(300'000, 5'500'000, 50);
    const auto place_of_its_top = [&] {
        Results results = results_of(cloud, {cloud.size()}, 2'000);
        std::get<PyramidJob>(results.request.job).epsg = 32733;
        const json root = parsed(tileset_files(results)).at("tileset.json")["root"];
        const std::vector<double> m = root["transform"];
        const Eigen::Matrix4d on_globe = Eigen::Map<const Eigen::Matrix4d>(m.data());
        const Aabb box = bounds(cloud);
        const Vec3d top = cloud.origin + Vec3d(0, 0, 1);
        const Vec3d from_middle = top - 0.5 * (box.min + box.max);
        return Vec3d(on_globe.topLeftCorner<3, 3>() * from_middle +
                     on_globe.topRightCorner<3, 1>());
    };
    const Vec3d place = place_of_its_top();
    cloud.positions.push_back((-cloud.origin).cast<float>());
    EXPECT_LT((place_of_its_top() - place).norm(), 0.1);
}

TEST(Tileset, IsNoneWithoutTiles) {
    EXPECT_TRUE(tileset_files({.request = {std::string(64, 'a'), PyramidJob{}},
                               .source = {},
                               .levels = {},
                               .complete = false,
                               .cost = {}})
                    .empty());
}

}  // namespace
}  // namespace stipple::proto
