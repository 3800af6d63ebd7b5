#include "documents.hpp"

#include "support/support.hpp"

#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

namespace stipple::test {

std::string golden(std::string_view name) {
    std::ifstream in(data_file("golden") / name);
    const std::string text{std::istreambuf_iterator<char>(in), {}};
    return nlohmann::ordered_json::parse(text).dump();
}

proto::JobRequest simplify_request() {
    proto::SimplifyJob job;
    job.options.points = 5000;
    job.options.reductions = {{"label", Reduction::Mode}, {"intensity", Reduction::Mean}};
    job.output.formats = {CloudFormat::Draco};
    job.output.draco.precision = 0.001;
    return {kInput, job};
}

proto::JobRequest particles_request() {
    proto::SimplifyJob job;
    job.options.method = Method::Particles;
    job.options.ratio = 0.25;
    job.options.particles.regions = {
        {.where = DensityRegion::Sphere{Vec3d(1, 2, 3), 0.5}, .density = 4, .transition = 0.25},
        {.where = DensityRegion::Box{Vec3d(-1, -1, -1), Vec3d(1, 1, 1)}, .density = 0.5},
        {.where = DensityRegion::Scalar{"intensity", 0.25, 0.75}, .density = 2}};
    job.added = {.splats = SplatAttributes::Ellipse, .source_index = true};
    return {kInput, job};
}

proto::JobRequest upsample_request() {
    proto::UpsampleJob job;
    job.options.points = 1'000'000;
    job.options.particles.seed = 7;
    return {kInput, job};
}

proto::JobRequest analyze_request() {
    proto::AnalyzeJob job;
    job.options.signs = NormalSigns::Viewpoint;
    job.options.viewpoint = Vec3d(0, 0, 10);
    job.options.feature_lines = FeatureLineOptions{};
    return {kInput, job};
}

proto::JobRequest evaluate_request() {
    proto::EvaluateJob job;
    job.candidates = {std::string(64, 'b'), std::string(64, 'c')};
    job.options.measure.samples = 50'000;
    job.options.measure.surface = ErrorSurface::Quadratic;
    job.options.range = 0.5;
    job.options.pictures = true;
    job.options.views = {"front", "top"};
    job.options.up = 'z';
    job.options.labels = {"one", "two"};
    job.output.formats = {CloudFormat::Draco};
    return {kInput, job};
}

proto::JobRequest pyramid_request() {
    proto::PyramidJob job;
    job.output.formats = {CloudFormat::Draco, CloudFormat::Ply, CloudFormat::Glb};
    return {kInput, job};
}

proto::CloudStatistics statistics() {
    return {.points = 1003,
            .non_finite = 2,
            .duplicates = 1,
            .bounds = {Vec3d(-1, -2.5, 0.1), Vec3d(1, 2.5, 3)},
            .attributes = {{"normal", "float32", 3}, {"label", "uint16", 1}},
            .encoding = "binary_little_endian",
            .skipped = {"face.vertex_indices"},
            .comments = {"made by hand"}};
}

proto::JobDocument failed_job() {
    proto::JobDocument document;
    document.id = std::string(32, 'b');
    document.request = simplify_request();
    document.input_name = "scan.ply";
    document.status = proto::JobStatus::Failed;
    document.progress = 12.5;
    document.stage = "decode";
    document.message = "failed while decoding";
    document.created = "2026-01-02T03:04:05.678Z";
    document.started = "2026-01-02T03:04:06.000Z";
    document.finished = "2026-01-02T03:04:07.000Z";
    document.updated = "2026-01-02T03:04:07.000Z";
    document.links = {{"self", "/v1/jobs/" + document.id, "application/json"}};
    document.problem = proto::problem_from(ErrorCode::MalformedInput, "line 7: no name");
    document.problem->stage = "decode";
    return document;
}

proto::CloudDocument cloud_document() {
    return {.id = kInput,
            .name = "scan.ply",
            .format = CloudFormat::Ply,
            .bytes = 12345,
            .created = "2026-01-02T03:04:05.678Z",
            .statistics = statistics(),
            .links = {{"content", "/v1/clouds/" + kInput + "/content", "model/ply"}}};
}

LodTile tile() {
    LodTile tile;
    tile.level = 1;
    tile.parent = 0;
    tile.points = 400;
    tile.offset = Vec3d(-1, -2.5, 0.25);
    tile.step = 0.125;
    tile.bits = 6;
    tile.last = {16, 40, 22};
    tile.error = {0.25, 1, 0.5, 0.125, 300};
    tile.spacing = 0.5;
    tile.cover_radius = 0.75;
    return tile;
}

DirectedError directed_error() {
    return {.max = 0.5,
            .max_at = Vec3d(600'000.5, 1, -2),
            .mean = 0.125,
            .mean_confidence = 0.0625,
            .rms = 0.25,
            .p50 = 0.125,
            .p95 = 0.375,
            .p99 = 0.4375,
            .histogram = {0.75, 0.25},
            .samples = 1000,
            .not_converged = 0.5,
            .cover_radius = 0.75,
            .attributes = {{"color", 8, 2, 4}},
            .positions = {},
            .distances = {}};
}

proto::ErrorFigures error_figures() {
    SurfaceError error{directed_error(), directed_error(), 4};
    error.backward.max = 1;
    return {.error = error, .range = 0.5, .warnings = {"a warning"}};
}

proto::OutputCloud output_cloud() {
    return {.level = 1,
            .points = 400,
            .spacing = 0.25,
            .bounds = {Vec3d(-1, -2.5, 0.1), Vec3d(1, 2.5, 3)},
            .files = {{CloudFormat::Draco,
                       900,
                       std::string(64, 'c'),
                       "level-1.drc",
                       {},
                       proto::FileError{0.1875, 1.125}},
                      {CloudFormat::Ply, 4900, std::string(64, 'd'), "level-1.ply"},
                      {CloudFormat::Glb, 1200, std::string(64, 'e'), std::string(64, 'e') + ".glb",
                       tile()}},
            .error = error_figures(),
            .decoded = LodFigures{{0.25, 1, 0.5, 0.125, 900}, 0.5, 0.75},
            .origin = Vec3d(0.5, -1, 2),
            .attributes = {{"color", "uint8", 3}, {"radius", "float32", 1}}};
}

proto::JobCost job_cost() {
    return {.decode_seconds = 0.5,
            .simplify_seconds = 1.25,
            .splats_seconds = 0.0625,
            .error_seconds = 0.03125,
            .encode_seconds = 0.125,
            .total_seconds = 2,
            .peak_memory_bytes = 50'000'000,
            .threads = 2};
}

proto::Results pyramid_results() {
    proto::OutputCloud coarsest;
    coarsest.points = 100;
    coarsest.spacing = 0.5;
    coarsest.bounds = output_cloud().bounds;
    coarsest.files = {{CloudFormat::Glb, 300, std::string(64, 'a'), "a.glb", tile()}};
    coarsest.files.front().tile->parent.reset();
    return {.request = pyramid_request(),
            .source = statistics(),
            .levels = {coarsest, output_cloud()},
            .complete = true,
            .cost = job_cost()};
}

proto::JobSpec job_spec() {
    return {.request = pyramid_request(),
            .input_file = "/data/in",
            .output_dir = "/data/out",
            .limits = {.max_points = 1000, .max_attributes = 8},
            .max_memory_bytes = 1 << 30,
            .max_cpu_seconds = 60,
            .max_file_bytes = 1 << 20,
            .threads = 2};
}

}  // namespace stipple::test
