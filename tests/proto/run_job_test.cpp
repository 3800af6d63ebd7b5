#include "run_job_fixture.hpp"

#include "stipple/proto/digest.hpp"
#include "stipple/surface_error.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <limits>
#include <map>
#include <string>
#include <thread>

namespace stipple::proto {
namespace {

namespace fs = std::filesystem;

const OutputOptions kPly{.formats = {CloudFormat::Ply}, .draco = {}};

SimplifyJob to_points(std::uint64_t points) {
    SimplifyJob job;
    job.options.points = points;
    job.output = kPly;
    return job;
}

Error error_of(const std::function<void()>& work) {
    try {
        work();
    } catch (const Error& error) {
        return error;
    }
    return Error(ErrorCode::Internal, "no error");
}

TEST_F(RunJob, WritesTheSimplifiedCloudAndTellsWhatItIs) {
    run(spec_for(test::with_attributes(test::sphere(2000)), to_points(300)));
    ASSERT_EQ(levels().size(), 1U);
    const OutputCloud level = levels().front();
    EXPECT_EQ(level.points, 300U);
    ASSERT_EQ(level.files.size(), 1U);

    const OutputFile& file = level.files.front();
    EXPECT_EQ(file.href, "level-0.ply");
    const fs::path path = folder_ / "out" / file.href;
    EXPECT_EQ(file.bytes, fs::file_size(path));
    EXPECT_EQ(file.sha256, sha256_of_file(path));
    const PointCloud cloud = read_cloud(path);
    EXPECT_EQ(cloud.size(), 300U);
    EXPECT_NE(find_attribute(cloud, "label"), nullptr);
    EXPECT_EQ(bounds(cloud).min, level.bounds.min);
    // 300 points share 4 pi: about sqrt(4 pi / 300) = 0.2 apart.
    EXPECT_GT(level.spacing, 0.1);
    EXPECT_LT(level.spacing, 0.3);
}

TEST_F(RunJob, SaysWhatWasMeasuredOfABoundedError) {
    if (test::kSanitized) GTEST_SKIP() << "too slow under a sanitizer";
    SimplifyJob job;
    job.options.method = Method::Hierarchical;
    job.options.max_error_rel = 0.02;
    job.output = kPly;
    const PointCloud cloud = test::sphere(1000);
    run(spec_for(cloud, job));
    ASSERT_EQ(levels().size(), 1U);
    ASSERT_TRUE(levels().front().bound);
    const MeasuredBound bound = *levels().front().bound;
    EXPECT_NEAR(bound.max_error, 0.02 * bounds(cloud).diagonal(), 1e-6);
    EXPECT_LE(std::max(bound.forward, bound.backward), bound.max_error);
    EXPECT_GT(bound.samples, 1000U);
    EXPECT_FALSE(bound.whole);
    ASSERT_TRUE(levels().front().error);  // no other measurement's
    EXPECT_EQ(levels().front().error->error.forward.max, bound.forward);
    EXPECT_EQ(levels().front().error->error.backward.max, bound.backward);
    const JobReport report = levels().front();
    EXPECT_EQ(to_json(job_report_from_json(to_json(report))), to_json(report));
}

TEST_F(RunJob, KeepsABoundedErrorInADracoFileThatRounds) {
    if (test::kSanitized) GTEST_SKIP() << "too slow under a sanitizer";
    const PointCloud cloud = test::sphere(1000);
    SimplifyJob job;
    job.options.method = Method::Hierarchical;
    job.options.max_error = 0.08;
    job.output.formats = {CloudFormat::Draco};
    job.output.draco.position_bits = 6;
    run(spec_for(cloud, job));
    const OutputCloud level = levels().front();
    ASSERT_TRUE(level.bound);
    EXPECT_NEAR(level.bound->max_error, 0.08, 1e-6);
    const double told = std::max(level.bound->forward, level.bound->backward);
    EXPECT_LE(told, 0.08);
    const double found = measure_error(cloud, read_cloud(folder_ / "out" / "level-0.drc")).max();
    EXPECT_LE(found, told);
    EXPECT_GT(found, 0.01);  // the grid alone makes that much

    job.options.max_error = 0.02;
    try {
        run(spec_for(cloud, job));
        FAIL() << "rounds by more";
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ErrorCode::InvalidArgument);
        EXPECT_NE(std::string(error.what()).find("max_error 0.02: expected more than 0.02803"),
                  std::string::npos)
            << error.what();
    }
}

TEST_F(RunJob, SaysWhatKeptABoundedErrorFromFewerPoints) {
    SimplifyJob job;
    job.options.max_error = 0.02;
    job.output = kPly;
    PointCloud cloud = test::sphere(1000);
    cloud.origin = {0, 0, 100};
    for (std::size_t i = 0; i < cloud.size(); i += 20) cloud.positions[i] *= 1.05F;  // noise
    run(spec_for(cloud, job));
    ASSERT_EQ(levels().size(), 1U);
    ASSERT_TRUE(levels().front().bound);
    const MeasuredBound bound = *levels().front().bound;
    EXPECT_TRUE(bound.whole);
    ASSERT_TRUE(bound.too_far);
    EXPECT_EQ(bound.too_far->points, 1000U);
    EXPECT_NEAR((bound.too_far->place - Vec3d(0, 0, 100)).norm(), 1.05, 1e-4);
    EXPECT_GT(bound.too_far->distance, 0.02);
    EXPECT_GE(bound.points_off_surface, 50U);
    const JobReport report = levels().front();
    EXPECT_EQ(to_json(job_report_from_json(to_json(report))), to_json(report));
}

TEST_F(RunJob, ACurveHasAnErrorForEachCountAndNoFiles) {
    CurveJob job;
    job.options.points = {50, 200, 500};
    run(spec_for(test::sphere(1000), job));
    ASSERT_EQ(levels().size(), 3U);
    for (const OutputCloud& level : levels()) {
        EXPECT_EQ(level.points, job.options.points.at(level.level));
        EXPECT_TRUE(level.files.empty());
        ASSERT_TRUE(level.curve);
        EXPECT_GT(level.curve->forward.max, level.curve->forward.mean);
        const JobReport report = level;
        EXPECT_EQ(to_json(job_report_from_json(to_json(report))), to_json(report));
    }
    EXPECT_EQ(files_written(), 0U);
}

TEST_F(RunJob, ReportsProgressThatNeverDecreasesAndEndsAtAHundred) {
    run(spec_for(test::sphere(20000), levels_of({100, 1000, 10000})));
    double last = 0;
    std::string stages;
    for (const JobReport& report : reports_) {
        const auto* const progress = std::get_if<JobProgress>(&report);
        if (progress == nullptr) continue;
        EXPECT_GE(progress->percent, last);
        last = progress->percent;
        if (stages.find(progress->stage) == std::string::npos) stages += progress->stage + " ";
    }
    EXPECT_EQ(last, 100);
    EXPECT_EQ(stages, "decode clean simplify encode ");
}

TEST_F(RunJob, ProgressIsLeftForWhatTakesTime) {
    run(spec_for(test::sphere(20000), levels_of({100, 1000, 10000})));
    std::map<std::string, double> begins;  // the percentage at the begin of a stage
    for (const JobReport& report : reports_)
        if (const auto* const progress = std::get_if<JobProgress>(&report))
            begins.try_emplace(progress->stage, progress->percent);
    EXPECT_EQ(begins.at("simplify"), 5);
    EXPECT_LE(begins.at("encode"), 40);
}

template <typename Kind>
bool holds(const JobReport& report) {
    return std::holds_alternative<Kind>(report);
}

TEST_F(RunJob, ReportsTheSourceBeforeAnyLevelAndTheCostLast) {
    run(spec_for(test::sphere(1000), to_points(10)));
    EXPECT_LT(std::ranges::find_if(reports_, holds<CloudStatistics>),
              std::ranges::find_if(reports_, holds<OutputCloud>));
    ASSERT_TRUE(holds<JobCost>(reports_.back()));
    const JobCost& cost = std::get<JobCost>(reports_.back());
    EXPECT_EQ(cost.threads, 2U);
    EXPECT_GT(cost.peak_memory_bytes, 1'000'000U);
    EXPECT_GT(cost.decode_seconds, 0);
    EXPECT_GT(cost.simplify_seconds, 0);
    EXPECT_GT(cost.splats_seconds, 0);
    EXPECT_GT(cost.encode_seconds, 0);
    EXPECT_GE(cost.total_seconds + 1e-9, cost.decode_seconds + cost.simplify_seconds +
                                             cost.splats_seconds + cost.encode_seconds);
}

TEST_F(RunJob, CountsWhatItRemovesFromTheSource) {
    PointCloud cloud = test::sphere(100);
    cloud.positions.push_back(cloud.positions.front());
    cloud.positions.push_back(Vec3f::Constant(std::numeric_limits<float>::quiet_NaN()));
    run(spec_for(cloud, to_points(1000)));
    ASSERT_TRUE(source());
    EXPECT_EQ(source()->points, 102U);
    EXPECT_EQ(source()->duplicates, 1U);
    EXPECT_EQ(source()->non_finite, 1U);
    EXPECT_EQ(levels().front().points, 100U);
}

TEST_F(RunJob, RemovesOutliersWhenAskedToAndCountsThem) {
    PointCloud cloud = test::sphere(2000);
    cloud.positions.emplace_back(5, 5, 5);
    cloud.positions.push_back(cloud.positions.front());
    SimplifyJob job = to_points(5000);
    job.added.source_index = true;
    run(spec_for(cloud, job));
    EXPECT_FALSE(source()->outliers);
    EXPECT_EQ(levels().front().points, 2001U);

    reports_.clear();
    job.outliers = OutlierOptions{};
    run(spec_for(cloud, job));
    EXPECT_EQ(source()->outliers, 1U);
    EXPECT_EQ(source()->removed(), 2U);
    EXPECT_LT(source()->bounds.max.x(), 1.1);
    EXPECT_EQ(levels().front().points, 2000U);
    EXPECT_LT(levels().front().bounds.max.x(), 1.1);

    reports_.clear();
    PyramidJob pyramid = levels_of({100});
    pyramid.outliers = OutlierOptions{};
    run(spec_for(cloud, pyramid));
    EXPECT_EQ(source()->outliers, 1U);
    EXPECT_LT(levels().front().bounds.max.x(), 1.1);
}

TEST_F(RunJob, RefusesUnusableCloudsWhoseOutliersItShouldRemove) {
    PointCloud cloud = test::sphere(200);
    cloud.positions.emplace_back(1e30F, 0, 0);
    SimplifyJob job = to_points(50);
    job.outliers = OutlierOptions{};
    const JobSpec spec = spec_for(cloud, job);
    EXPECT_EQ(error_of([&] { run(spec); }).code(), ErrorCode::MalformedInput);
    EXPECT_EQ(source()->points, 201U);
    EXPECT_FALSE(source()->outliers);
}

TEST_F(RunJob, SaysWhyNoPointIsLeft) {
    PointCloud cloud;
    cloud.positions.assign(7, Vec3f::Constant(std::numeric_limits<float>::infinity()));
    const JobSpec spec = spec_for(cloud, to_points(10));
    const Error error = error_of([&] { run(spec); });
    EXPECT_EQ(error.code(), ErrorCode::MalformedInput);
    EXPECT_STREQ(error.what(),
                 "no point is left: of 7 in the file 7 have a NaN or infinite coordinate and 0 are "
                 "duplicates");
    EXPECT_EQ(source()->non_finite, 7U);  // the statistics are told nevertheless
}

TEST_F(RunJob, RefusesACloudWithoutPoints) {
    const JobSpec spec = spec_for(PointCloud(), levels_of({10}));
    const Error error = error_of([&] { run(spec); });
    EXPECT_EQ(error.code(), ErrorCode::MalformedInput);
    EXPECT_STREQ(error.what(), "the file holds no points");
    EXPECT_EQ(files_written(), 0U);
}

TEST_F(RunJob, RefusesCloudsWhoseSquaresAreBeyondSinglePrecision) {
    for (const float scale : {1e-30F, 1e-14F, 1e14F, 1e30F}) {
        PointCloud cloud = test::sphere(200);
        for (Vec3f& p : cloud.positions) p *= scale;
        const JobSpec spec = spec_for(cloud, to_points(50));
        if (scale > 1e-20F && scale < 1e20F) {
            run(spec);
            EXPECT_EQ(levels().front().points, 50U) << scale;
            continue;
        }
        const Error error = error_of([&] { run(spec); });
        EXPECT_EQ(error.code(), ErrorCode::MalformedInput);
        const std::string what = error.what();
        EXPECT_NE(what.find("across: expected 1e-15 to 1e+15, or a single place; give it in a"),
                  std::string::npos)
            << what;
    }
}

TEST_F(RunJob, ReducesAnAttributeAsAsked) {
    SimplifyJob job = to_points(1);
    job.options.reductions = {{"label", Reduction::Max}, {"height", Reduction::Min}};
    run(spec_for(test::with_attributes(test::sphere(500)), job));
    const PointCloud cloud = read_cloud(folder_ / "out" / "level-0.ply");
    const Attribute* label = find_attribute(cloud, "label");
    ASSERT_NE(label, nullptr);
    EXPECT_EQ(std::get<std::vector<std::int32_t>>(label->values).front(), 1'000'003);
    const Attribute* height = find_attribute(cloud, "height");
    ASSERT_NE(height, nullptr);
    EXPECT_LT(std::get<std::vector<float>>(height->values).front(), -0.99F);
}

TEST_F(RunJob, RefusesAReductionOfAnAttributeThatIsNotThere) {
    SimplifyJob job = to_points(10);
    job.options.reductions = {{"intensity", Reduction::Max}};
    const JobSpec spec = spec_for(test::with_attributes(test::sphere(100)), job);
    const Error error = error_of([&] { run(spec); });
    EXPECT_EQ(error.code(), ErrorCode::InvalidArgument);
    EXPECT_NE(std::string(error.what()).find("intensity"), std::string::npos);
}

TEST_F(RunJob, AddsTheRadiusOfEverySplatUnlessToldOtherwise) {
    const PointCloud sphere = test::sphere(2000);
    run(spec_for(sphere, to_points(300)));
    PointCloud cloud = read_cloud(output());
    const Attribute* radius = find_attribute(cloud, "radius");
    ASSERT_NE(radius, nullptr);
    for (const float r : std::get<std::vector<float>>(radius->values)) EXPECT_GT(r, 0.01F);
    EXPECT_TRUE(cloud.normals.empty());

    SimplifyJob job = to_points(300);
    job.added.splats = SplatAttributes::None;
    run(spec_for(sphere, job));
    EXPECT_TRUE(read_cloud(output()).attributes.empty());

    job.added.splats = SplatAttributes::Ellipse;
    run(spec_for(sphere, job));
    cloud = read_cloud(output());
    EXPECT_EQ(cloud.normals.size(), 300U);
    for (const char* name : {"major", "minor"}) {
        ASSERT_NE(find_attribute(cloud, name), nullptr) << name;
        EXPECT_EQ(find_attribute(cloud, name)->components, 3U);
    }
}

TEST_F(RunJob, TellsWhichPointOfTheFileEachPointWas) {
    PointCloud cloud = test::sphere(500);
    // What cleaning removes is counted, too.
    cloud.positions[3] = Vec3f::Constant(std::numeric_limits<float>::quiet_NaN());
    cloud.positions[8] = cloud.positions[7];
    SimplifyJob job = to_points(100);
    job.options.method = Method::Hierarchical;  // whose points are points of the input
    job.added.source_index = true;
    run(spec_for(cloud, job));
    EXPECT_TRUE(source()->attributes.empty());  // it is not the file's
    const PointCloud result = read_cloud(output());
    ASSERT_EQ(result.size(), 100U);
    const Attribute* index = find_attribute(result, "source_index");
    ASSERT_NE(index, nullptr);
    const auto& numbers = std::get<std::vector<std::uint32_t>>(index->values);
    for (std::size_t i = 0; i < result.size(); ++i) {
        EXPECT_EQ(result.positions[i], cloud.positions[numbers[i]]);
    }
}

TEST_F(RunJob, UpsamplesToMorePointsThanThereAre) {
    UpsampleJob job;
    job.output = kPly;
    job.options.ratio = 2;
    run(spec_for(test::sphere(400), job));
    EXPECT_EQ(levels().front().points, 800U);
    EXPECT_NE(find_attribute(read_cloud(output()), "radius"), nullptr);

    job.options.ratio.reset();
    job.options.points = 400;
    const JobSpec spec = spec_for(test::sphere(400), job);
    EXPECT_STREQ(error_of([&] { run(spec); }).what(),
                 "points 400: expected more than the 400 of the cloud; simplify yields fewer");
}

TEST_F(RunJob, TakesTheCoordinatesOfRegionsFromTheFile) {
    // A million units away: a region around its own coordinates must still be found.
    PointCloud cloud = test::plane(4000);
    cloud.origin = Vec3d(1e6, -2e6, 3e6);
    cloud.double_precision = true;
    const Aabb box = bounds(cloud);
    SimplifyJob job = to_points(500);
    job.options.method = Method::Particles;
    DensityRegion::Box left{box.min, box.max};
    left.max.x() = (box.min.x() + box.max.x()) / 2;
    left.min -= Vec3d::Ones();
    left.max.z() += 1;
    job.options.particles.regions = {{.where = left, .density = 8, .transition = 0.01}};
    run(spec_for(cloud, job));
    const PointCloud result = read_cloud(output());
    const auto in_left = std::ranges::count_if(
        result.positions, [&](const Vec3f& p) { return p.x() + result.origin.x() < left.max.x(); });
    EXPECT_GT(in_left, 400);  // 8/9 of them lie there
}

TEST_F(RunJob, AnalyzeWritesTheLocalPropertiesOfEveryPoint) {
    AnalyzeJob job;
    job.output = kPly;
    run(spec_for(test::with_attributes(test::sphere(3000)), job));
    const PointCloud cloud = read_cloud(output());
    ASSERT_EQ(cloud.size(), 3000U);
    ASSERT_EQ(cloud.normals.size(), 3000U);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        EXPECT_GT(cloud.normals[i].dot(cloud.positions[i].normalized()), 0.9F);  // outward
    }
    for (const char* name : {"variation", "density", "anisotropy", "label"}) {
        EXPECT_NE(find_attribute(cloud, name), nullptr) << name;
    }
}

TEST_F(RunJob, AnalyzeTurnsNormalsTowardsAViewpointInTheFile) {
    PointCloud cloud = test::plane(1000);
    cloud.origin = Vec3d(1e6, 1e6, 1e6);
    cloud.double_precision = true;
    const Vec3d center = (bounds(cloud).min + bounds(cloud).max) / 2;
    AnalyzeJob job;
    job.output = kPly;
    job.options.signs = NormalSigns::Viewpoint;
    job.options.viewpoint = center - Vec3d(0, 0, 5);
    run(spec_for(cloud, job));
    for (const Vec3f& normal : read_cloud(output()).normals) EXPECT_LT(normal.z(), -0.9F);
}

TEST_F(RunJob, AnalyzeFindsTheLinesWhereTwoPlanesMeet) {
    PointCloud roof;
    for (int i = 0; i < 60; ++i) {
        for (int j = 0; j < 60; ++j) {
            const float x = static_cast<float>(i) / 59.0F;
            roof.positions.emplace_back(x, static_cast<float>(j) / 59.0F, std::abs(x - 0.5F));
        }
    }
    AnalyzeJob job;
    job.output = kPly;
    job.options.feature_lines = FeatureLineOptions{};
    run(spec_for(roof, job));
    EXPECT_NE(find_attribute(read_cloud(output()), "feature_weight"), nullptr);
    ASSERT_EQ(levels().size(), 2U);
    const PointCloud lines = read_cloud(folder_ / "out" / "level-1.ply");
    EXPECT_EQ(levels()[1].points, lines.size());
    EXPECT_GT(lines.size(), 8U);
    const Attribute* line = find_attribute(lines, "line");
    ASSERT_NE(line, nullptr);
    EXPECT_EQ(std::get<std::vector<std::uint32_t>>(line->values).front(), 0U);
    for (const Vec3f& p : lines.positions) EXPECT_NEAR(p.x(), 0.5F, 0.05F);

    job.output.formats = {CloudFormat::Draco};  // which keeps points of a line in their order, too
    run(spec_for(roof, job));
    const PointCloud decoded = read_cloud(folder_ / "out" / "level-1.drc");
    ASSERT_EQ(decoded.size(), lines.size());
    for (std::size_t i = 0; i < lines.size(); ++i)
        EXPECT_LT((decoded.positions[i] - lines.positions[i]).norm(), 1e-3F) << i;

    reports_.clear();
    run(spec_for(test::plane(1000), job));  // without any
    EXPECT_EQ(levels().size(), 1U);
}

TEST_F(RunJob, RefusesAFileOverALimitByItsHeader) {
    JobSpec spec = spec_for(test::sphere(100), to_points(10));
    spec.limits.max_points = 99;
    EXPECT_EQ(error_of([&] { run(spec); }).code(), ErrorCode::TooLarge);
}

TEST_F(RunJob, EndsWithCancelledWhenAskedToStop) {
    std::stop_source stop;
    const JobSpec spec = spec_for(test::sphere(100'000), to_points(5000));
    const auto stop_at_simplify = [&stop](const JobReport& report) {
        const auto* const progress = std::get_if<JobProgress>(&report);
        if (progress != nullptr && progress->stage == "simplify") stop.request_stop();
    };
    EXPECT_THROW(run_job(spec, stop_at_simplify, {.stop = stop.get_token(), .progress = {}}),
                 Cancelled);
    EXPECT_EQ(files_written(), 0U);
}

TEST_F(RunJob, GivesTheSameBytesForAnyNumberOfThreads) {
    std::map<unsigned, std::string> hashes;
    const PointCloud cloud = test::with_attributes(test::sphere(5000, 0.01));
    for (const unsigned threads : {1U, 4U}) {
        JobSpec spec = spec_for(cloud, to_points(500));
        spec.threads = threads;
        reports_.clear();
        run(spec);
        hashes[threads] = levels().front().files.front().sha256;
    }
    EXPECT_EQ(hashes[1], hashes[4]);
}

TEST(MemoryLimitMessage, NamesTheMethodAndOneThatNeedsLess) {
    JobSpec spec;
    spec.max_memory_bytes = 1000;
    const auto message_of = [&](Method method) {
        SimplifyJob job;
        job.options.method = method;
        spec.request.job = job;
        return memory_limit_message(spec);
    };
    EXPECT_EQ(
        message_of(Method::Iterative),
        "the job needs more than the 1000 bytes of memory that it may have, by the size of its "
        "input and the limits: upload a smaller cloud, use another method than iterative "
        "(multiphase needs less), or have the server's --max-memory raised");
    EXPECT_NE(message_of(Method::Multiphase).find("multiphase (voxel needs less)"),
              std::string::npos);
    EXPECT_EQ(message_of(Method::Random).find("another method"), std::string::npos);
}

}  // namespace
}  // namespace stipple::proto
