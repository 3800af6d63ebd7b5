#include "json_parts.hpp"
#include "stipple/proto/digest.hpp"

#include <algorithm>
#include <span>

namespace stipple::proto {

namespace {

void put_figures(Json& json, const LodFigures& figures) {
    json["error"] = {{"mean", figures.error.mean},
                     {"max", figures.error.max},
                     {"p99", figures.error.p99},
                     {"mean_confidence", figures.error.mean_confidence},
                     {"samples", figures.error.samples}};
    json["spacing"] = figures.spacing;
    json["cover_radius"] = figures.cover_radius;
}

void read_figures(JsonObject& object, LodFigures& figures) {
    JsonObject error = object["error"].object();
    figures.error = {.mean = error["mean"].number(),
                     .max = error["max"].number(),
                     .p99 = error["p99"].number(),
                     .mean_confidence = error["mean_confidence"].number(),
                     .samples = error["samples"].integer()};
    error.finish();
    figures.spacing = object["spacing"].number();
    figures.cover_radius = object["cover_radius"].number();
}

/// All tiles of a level have the same bits.
Json decoded_json(const LodFigures& figures, std::span<const OutputFile> files) {
    Json json;
    const auto tile = std::ranges::find_if(files, [](const auto& file) { return !!file.tile; });
    if (tile != files.end()) json["bits"] = tile->tile->bits;
    put_figures(json, figures);
    return json;
}

LodFigures read_decoded(const JsonValue& value) {
    JsonObject object = value.object();
    LodFigures figures;
    if (const auto bits = object.find("bits")) bits->small_integer();
    read_figures(object, figures);
    object.finish();
    return figures;
}

Json tile_json(const LodTile& tile) {
    Json json;
    if (tile.parent) json["parent"] = *tile.parent;
    json["points"] = tile.points;
    json["bits"] = tile.bits;
    json["step"] = tile.step;
    json["offset"] = vector_json(tile.offset);
    json["last"] = tile.last;
    put_figures(json, tile);
    return json;
}

LodTile read_tile(const JsonValue& value) {
    JsonObject object = value.object();
    LodTile tile;
    if (const auto parent = object.find("parent")) tile.parent = parent->small_integer();
    tile.points = object["points"].integer(1);
    tile.bits = object["bits"].small_integer();
    tile.step = object["step"].number();
    tile.offset = read_vector(object["offset"]);
    const JsonValue last = object["last"];
    const std::vector<JsonValue> numbers = last.items();
    if (numbers.size() != tile.last.size()) last.refuse("3 numbers");
    for (std::size_t axis = 0; axis < numbers.size(); ++axis)
        tile.last[axis] = static_cast<std::uint16_t>(numbers[axis].integer(0, 65'535));
    read_figures(object, tile);
    object.finish();
    return tile;
}

Json file_json(const OutputFile& file) {
    Json json = {{"format", to_string(file.format)},
                 {"bytes", file.bytes},
                 {"sha256", file.sha256},
                 {"href", file.href}};
    if (file.tile) json["tile"] = tile_json(*file.tile);
    if (file.error) json["error"] = {{"mean", file.error->mean}, {"max", file.error->max}};
    return json;
}

FileError read_file_error(const JsonValue& value) {
    JsonObject object = value.object();
    const FileError error{object["mean"].number(), object["max"].number()};
    object.finish();
    return error;
}

/// Names files, so it must be nothing else.
std::string read_sha256(const JsonValue& value) {
    if (!is_sha256(value.text())) value.refuse("64 lower-case hexadecimal digits");
    return value.text();
}

OutputFile read_file(const JsonValue& value) {
    JsonObject object = value.object();
    OutputFile file;
    file.format = object["format"].named(cloud_format_from_name);
    file.bytes = object["bytes"].integer();
    file.sha256 = read_sha256(object["sha256"]);
    file.href = object["href"].text();
    if (const auto tile = object.find("tile")) file.tile = read_tile(*tile);
    if (const auto error = object.find("error")) file.error = read_file_error(*error);
    object.finish();
    return file;
}

Json picture_json(const PictureFile& picture) {
    return {{"width", picture.width},
            {"height", picture.height},
            {"bytes", picture.bytes},
            {"sha256", picture.sha256},
            {"href", picture.href}};
}

PictureFile read_picture(const JsonValue& value) {
    JsonObject object = value.object();
    PictureFile picture;
    picture.width = object["width"].small_integer();
    picture.height = object["height"].small_integer();
    picture.bytes = object["bytes"].integer();
    picture.sha256 = read_sha256(object["sha256"]);
    picture.href = object["href"].text();
    object.finish();
    return picture;
}

ErrorFigures read_whole_error(const JsonValue& value) {
    JsonObject object = value.object();
    ErrorFigures figures = read_error(object);
    object.finish();
    return figures;
}

Json bound_json(const MeasuredBound& bound) {
    Json json = {{"max_error", bound.max_error},
                 {"forward", bound.forward},
                 {"backward", bound.backward},
                 {"samples", bound.samples},
                 {"sampling", to_string(bound.sampling)},
                 {"tries", bound.tries},
                 {"whole", bound.whole}};
    if (bound.points_off_surface > 0) json["points_off_surface"] = bound.points_off_surface;
    if (bound.ended_early) json["ended_early"] = true;
    if (bound.too_far)
        json["too_far"] = {{"points", bound.too_far->points},
                           {"place", vector_json(bound.too_far->place)},
                           {"distance", bound.too_far->distance}};
    return json;
}

TooFar read_too_far(const JsonValue& value) {
    JsonObject object = value.object();
    TooFar tried;
    tried.points = object["points"].integer(1);
    tried.place = read_vector(object["place"]);
    tried.distance = object["distance"].number();
    object.finish();
    return tried;
}

MeasuredBound read_bound(const JsonValue& value) {
    JsonObject object = value.object();
    MeasuredBound bound;
    bound.max_error = object["max_error"].number();
    bound.forward = object["forward"].number();
    bound.backward = object["backward"].number();
    bound.samples = object["samples"].integer();
    bound.sampling = object["sampling"].named(error_sampling_from_name);
    if (const auto off = object.find("points_off_surface"))
        bound.points_off_surface = off->integer();
    bound.tries = object["tries"].small_integer();
    bound.whole = object["whole"].boolean();
    if (const auto early = object.find("ended_early")) bound.ended_early = early->boolean();
    if (const auto too_far = object.find("too_far")) bound.too_far = read_too_far(*too_far);
    object.finish();
    return bound;
}

Json distances_json(const CurveDistances& distances) {
    return {{"max", distances.max}, {"mean", distances.mean}, {"rms", distances.rms}};
}

CurveDistances read_distances(const JsonValue& value) {
    JsonObject object = value.object();
    const CurveDistances distances{object["max"].number(), object["mean"].number(),
                                   object["rms"].number()};
    object.finish();
    return distances;
}

Json curve_json(const CurveError& error) {
    return {{"forward", distances_json(error.forward)},
            {"backward", distances_json(error.backward)},
            {"diagonal", error.diagonal}};
}

CurveError read_curve(const JsonValue& value) {
    JsonObject object = value.object();
    const CurveError error{read_distances(object["forward"]), read_distances(object["backward"]),
                           object["diagonal"].number()};
    object.finish();
    return error;
}

}  // namespace

Json files_json(const OutputCloud& cloud) {
    Json files = Json::array();
    for (const OutputFile& file : cloud.files) files.push_back(file_json(file));
    return files;
}

Json pictures_json(const OutputCloud& cloud) {
    Json pictures = Json::array();
    for (const PictureFile& picture : cloud.pictures) pictures.push_back(picture_json(picture));
    return pictures;
}

Json level_json(const OutputCloud& cloud) {
    Json json = {{"level", cloud.level},
                 {"points", cloud.points},
                 {"spacing", cloud.spacing},
                 {"bounds", bounds_json(cloud.bounds)}};
    if (cloud.origin) json["origin"] = vector_json(*cloud.origin);
    json["attributes"] = attributes_json(cloud.attributes);
    json["files"] = files_json(cloud);
    if (cloud.error) json["error"] = error_json(*cloud.error);
    if (cloud.decoded) json["decoded"] = decoded_json(*cloud.decoded, cloud.files);
    if (!cloud.pictures.empty()) json["pictures"] = pictures_json(cloud);
    if (cloud.bound) json["bound"] = bound_json(*cloud.bound);
    if (cloud.curve) json["curve"] = curve_json(*cloud.curve);
    return json;
}

OutputCloud read_level(const JsonValue& value) {
    JsonObject object = value.object();
    OutputCloud cloud;
    cloud.level = object["level"].small_integer();
    cloud.points = object["points"].integer();
    cloud.spacing = object["spacing"].number();
    cloud.bounds = read_bounds(object["bounds"]);
    if (const auto origin = object.find("origin")) cloud.origin = read_vector(*origin);
    cloud.attributes = read_attributes(object["attributes"]);
    cloud.files = object["files"].list_of(read_file);
    for (OutputFile& file : cloud.files)
        if (file.tile) file.tile->level = cloud.level;
    if (const auto error = object.find("error")) cloud.error = read_whole_error(*error);
    if (const auto decoded = object.find("decoded")) cloud.decoded = read_decoded(*decoded);
    if (const auto pictures = object.find("pictures"))
        cloud.pictures = pictures->list_of(read_picture);
    if (const auto bound = object.find("bound")) cloud.bound = read_bound(*bound);
    if (const auto curve = object.find("curve")) cloud.curve = read_curve(*curve);
    object.finish();
    return cloud;
}

std::string to_json(const MeasuredBound& bound) {
    return to_text(bound_json(bound));
}

std::string to_json(const CurveError& error) {
    return to_text(curve_json(error));
}

}  // namespace stipple::proto
