#include "http/client_watch.hpp"
#include "http/conditional.hpp"
#include "http/job_fields.hpp"
#include "http/output_reply.hpp"
#include "http/query.hpp"
#include "http/routes.hpp"
#include "http/tar.hpp"

#include "stipple/proto/digest.hpp"
#include "stipple/proto/pyramid_export.hpp"
#include "stipple/proto/slice.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <ctime>
#include <nlohmann/json.hpp>

namespace stipple::server::http {

namespace {

constexpr std::array kSliceFormats = {CloudFormat::Ply, CloudFormat::Draco, CloudFormat::Glb};

/// `inline`, which may ask for one format.
std::optional<CloudFormat> query_inline(const Request& request, CloudFormat format) {
    const auto wanted = request.query_value("inline");
    if (!wanted) return std::nullopt;
    if (*wanted != to_string(format)) refuse("inline", *wanted, std::string(to_string(format)));
    return format;
}

Reply tileset_reply(Resources& resources, const Request& request, const std::string& name) {
    allow_query(request, {"inline", "error", "errorScale"});
    DocumentOptions options{.inlined = query_inline(request, CloudFormat::Glb)};
    if (const auto error = request.query_value("error"))
        options.tileset.error = proto::tileset_error_from_name(*error);
    options.tileset.error_scale = query_number(request, "errorScale").value_or(1);
    validate(options.tileset);
    return document_reply(resources, request, name, options);
}

/// A pyramid as far as it is made.
std::shared_ptr<const proto::Results> pyramid_of(Resources& resources, const Request& request) {
    const std::string& id = request.path_value("id");
    auto results = resources.service.outputs().results(request.tenant, id);
    if (!results || !std::holds_alternative<proto::PyramidJob>(results->request.job))
        throw Error(ErrorCode::NotFound, "no such pyramid: " + id);
    return results;
}

/// A finished pyramid.
std::shared_ptr<const proto::Results> whole_pyramid(Resources& resources, const Request& request) {
    auto results = pyramid_of(resources, request);
    if (!results->complete)
        throw Error(ErrorCode::Conflict, "the job of this pyramid has not succeeded, or not yet");
    return results;
}

/// `x0,y0,z0,x1,y1,z1`.
std::optional<Aabb> query_box(const Request& request) {
    const auto text = request.query_value("box");
    if (!text) return std::nullopt;
    std::array<double, 6> numbers{};
    const char* at = text->data();
    const char* const end = at + text->size();
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        const auto [next, error] = std::from_chars(at, end, numbers[i]);
        const bool last = i + 1 == numbers.size();
        if (error != std::errc() || (last ? next != end : next == end || *next != ','))
            refuse("box", *text, "six numbers, x0,y0,z0,x1,y1,z1");
        at = next + 1;
    }
    return Aabb{Vec3d(numbers[0], numbers[1], numbers[2]),
                Vec3d(numbers[3], numbers[4], numbers[5])};
}

proto::SliceOptions read_slice_query(const Request& request) {
    std::vector<std::string_view> names = {"points", "bytes", "max_error", "box", "format"};
    add_names(names, kDracoFields);
    allow_query(request, names);
    const std::uint64_t most = proto::SliceOptions{}.max_points;
    proto::SliceOptions options{.points = query_count(request, "points", 1, most),
                                .bytes = query_count(request, "bytes", 1, INT64_MAX),
                                .box = query_box(request)};
    const auto bound = request.query_value("max_error");
    if (bound && bound->ends_with('%'))
        options.max_error_rel = proto::part_of_diagonal(*bound);
    else
        options.max_error = query_number(request, "max_error");
    if (const auto format = request.query_value("format")) {
        const auto known =
            std::ranges::find(kSliceFormats, *format, [](CloudFormat f) { return to_string(f); });
        if (known == kSliceFormats.end()) refuse("format", *format, "ply, drc or glb");
        options.format = *known;
    }
    options.draco = query_draco(request, options.format);
    validate(options);
    return options;
}

/// On one thread, so that all places together leave processors for jobs.
/// @throws Disconnected when the client leaves meanwhile; HttpError(503) when it takes too long.
proto::Slice cut(Resources& resources, const Request& request, const proto::Results& pyramid,
                 const proto::SliceOptions& options) {
    const auto permit = resources.slices.take(request);
    const auto read = [&](const proto::OutputFile& file) {
        return server::read_all(*resources.service.outputs().open(file.sha256));
    };
    const ClientWatch watch(request, kLongestSlice);
    try {
        return proto::slice_pyramid(pyramid, options, read, {.stop = watch.left(), .threads = 1});
    } catch (const Cancelled&) {
        if (!watch.is_late()) throw Disconnected();
        proto::Problem problem = proto::problem_from_status(
            503, "the slice was not ready after " + std::to_string(kLongestSlice.count()) +
                     " s: ask for fewer points, or for the level's own files");
        problem.retry_after = 30;
        throw HttpError(std::move(problem));
    }
}

/// Sends the files of a pyramid one after the other. A slow reader holds what names them, and
/// nothing of what is in them.
class TarStream {
public:
    TarStream(Outputs& outputs, const proto::Results& pyramid, std::chrono::sys_seconds modified)
        : outputs_(outputs), modified_(modified) {
        for (const proto::ExportFile& file : proto::export_files(pyramid)) {
            if (file.stored != nullptr) {
                files_.push_back({file.name, file.stored->bytes, file.stored->sha256, nullptr});
            } else {
                auto held = outputs.hold(std::as_bytes(std::span(file.text)));
                files_.push_back({file.name, file.text.size(), {}, std::move(held)});
            }
        }
    }

    std::uint64_t size() const {
        std::uint64_t sum = tar_end().size();
        for (const File& file : files_) sum += tar_bytes(file.bytes);
        return sum;
    }

    void operator()(const StreamWriter& write) const {
        constexpr std::size_t kPieceBytes = 256 * 1024;
        std::vector<std::byte> piece(kPieceBytes);
        for (const File& file : files_) {
            const std::uint64_t size = file.bytes;
            write(tar_header(file.name, size, modified_));
            const auto blob = file.held ? file.held : outputs_.open(file.sha256);
            if (blob->size() != size)
                throw Error(ErrorCode::Internal, file.name + ": its bytes are not those listed");
            for (std::uint64_t at = 0; at < size;) {
                const std::size_t n = blob->read(at, piece);
                if (n == 0) throw Error(ErrorCode::Internal, file.name + ": its bytes end early");
                write({reinterpret_cast<const char*>(piece.data()), n});
                at += n;
            }
            if (const std::string padding = tar_padding(size); !padding.empty()) write(padding);
        }
        write(tar_end());
    }

private:
    struct File {
        std::string name;
        std::uint64_t bytes;
        std::string sha256;                      ///< of a blob
        std::shared_ptr<const BlobReader> held;  ///< instead
    };

    Outputs& outputs_;
    std::vector<File> files_;
    std::chrono::sys_seconds modified_;
};

/// Of `2026-11-21T17:00:00.000Z`.
std::chrono::sys_seconds time_of(const std::string& rfc3339) {
    std::tm time{};
    if (::strptime(rfc3339.c_str(), "%Y-%m-%dT%H:%M:%S", &time) == nullptr) return {};
    return std::chrono::sys_seconds(std::chrono::seconds(::timegm(&time)));
}

}  // namespace

Reply get_slice(Resources& resources, Request& request) {
    const proto::SliceOptions options = read_slice_query(request);
    const auto pyramid = whole_pyramid(resources, request);
    auto permit = resources.downloads.take(request);
    const proto::Slice slice = cut(resources, request, *pyramid, options);
    Reply reply;
    reply.media_type = media_type(options.format);
    reply.content =
        StoredRange{resources.service.outputs().hold(slice.bytes), 0, slice.bytes.size()};
    reply.permit = std::move(permit);
    reply.headers.set("X-Content-Type-Options", "nosniff");
    reply.headers.set("Stipple-Points", std::to_string(slice.points));
    reply.headers.set("Stipple-Level", std::to_string(slice.level));
    if (slice.error_mean && slice.error_max) {
        reply.headers.set("Stipple-Error-Mean", nlohmann::json(*slice.error_mean).dump());
        reply.headers.set("Stipple-Error-Max", nlohmann::json(*slice.error_max).dump());
    }
    if (options.format == CloudFormat::Draco) tell_origin(reply, slice.origin);
    // The same query gives the same bytes until the server is another one.
    return tagged_reply(request, proto::sha256_hex(slice.bytes),
                        std::string(resources.with_keys ? "private" : "public") + ", max-age=86400",
                        std::move(reply));
}

Reply get_pyramid_archive(Resources& resources, Request& request) {
    allow_query(request, {});
    const std::string& id = request.path_value("id");
    const auto pyramid = whole_pyramid(resources, request);
    const auto finished = time_of(resources.service.job(request.tenant, id).finished);
    auto permit = resources.downloads.take(request);
    auto turn = document_turn(resources, request);
    TarStream tar(resources.service.outputs(), *pyramid, finished);
    turn.reset();
    const std::uint64_t size = tar.size();
    Reply reply{.status = 200,
                .headers = {},
                .media_type = "application/x-tar",
                .content = SizedStream{std::move(tar), size},
                .permit = std::move(permit)};
    reply.headers.set("Content-Disposition", "attachment; filename=\"pyramid-" + id + ".tar\"");
    reply.headers.set("Cache-Control", "no-store");
    reply.headers.set("X-Content-Type-Options", "nosniff");
    return reply;
}

Reply get_manifest(Resources& resources, Request& request) {
    allow_query(request, {"inline"});
    return document_reply(resources, request, "manifest.json",
                          {.inlined = query_inline(request, CloudFormat::Draco)});
}

Reply get_tileset(Resources& resources, Request& request) {
    return tileset_reply(resources, request, "tileset.json");
}

Reply get_stream(Resources& resources, Request& request) {
    const auto pyramid = pyramid_of(resources, request);
    for (const proto::OutputCloud& level : pyramid->levels)
        for (const proto::OutputFile& file : level.files)
            if (file.format == CloudFormat::Progressive)
                return output_reply(resources, request, request.path_value("id"),
                                    file.sha256 + ".stpc");
    throw HttpError(
        404,
        "no such stream: stpc is not among the formats of this pyramid, or it is not there yet");
}

Reply get_pyramid_file(Resources& resources, Request& request) {
    const std::string& file = request.path_value("file");
    if (file.starts_with("tileset-")) return tileset_reply(resources, request, file);
    return output_reply(resources, request, request.path_value("id"), file);
}

}  // namespace stipple::server::http
