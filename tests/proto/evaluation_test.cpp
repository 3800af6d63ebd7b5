#include "stipple/proto/evaluation.hpp"

#include "documents.hpp"
#include "stipple/proto/run_job.hpp"
#include "stipple/splat_renderer.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <cmath>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

namespace stipple::proto {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

PointCloud scaled(PointCloud cloud, float factor) {
    for (Vec3f& p : cloud.positions) p *= factor;
    return cloud;
}

PointCloud moved(PointCloud cloud, const Vec3f& by) {
    for (Vec3f& p : cloud.positions) p += by;
    return cloud;
}

/// Jobs on clouds in a folder of its own.
class Evaluation : public testing::Test {
protected:
    Evaluation() { fs::create_directory(folder_ / "out"); }

    /// The results of comparing `candidates` with `reference`.
    Results evaluate(const PointCloud& reference, const std::vector<PointCloud>& candidates,
                     EvaluateJob job = {}) {
        if (job.options.measure.samples == 0) job.options.measure.samples = 2000;
        JobSpec spec = spec_for("reference.ply");
        write_cloud(reference, spec.input_file);
        for (std::size_t i = 0; i < candidates.size(); ++i) {
            spec.candidate_files.push_back(folder_ / (std::to_string(i) + ".ply"));
            write_cloud(candidates[i], spec.candidate_files.back());
            job.candidates.emplace_back(64, static_cast<char>('b' + i));
        }
        spec.request = {std::string(64, 'a'), job};
        return run(spec);
    }

    JobSpec spec_for(const char* input) const {
        JobSpec spec;
        spec.input_file = folder_ / input;
        spec.output_dir = folder_ / "out";
        return spec;
    }

    Results run(const JobSpec& spec) {
        Results results;
        results.request = spec.request;
        run_job(spec, [&](const JobReport& report) {
            if (const auto* source = std::get_if<CloudStatistics>(&report))
                results.source = *source;
            if (const auto* level = std::get_if<OutputCloud>(&report))
                results.levels.push_back(*level);
            if (const auto* cost = std::get_if<JobCost>(&report)) results.cost = *cost;
        });
        results.complete = true;
        return results;
    }

    /// The figures of one candidate as they are told.
    json figures(const PointCloud& reference, const PointCloud& candidate, EvaluateJob job = {}) {
        return json::parse(evaluation_json(evaluate(reference, {candidate}, std::move(job))));
    }

    test::TemporaryFolder folder_;
};

TEST_F(Evaluation, TellsThatItDecodesWhenACandidateCannotBeDecoded) {
    JobSpec spec = spec_for("reference.ply");
    write_cloud(test::sphere(100), spec.input_file);
    spec.candidate_files = {folder_ / "0.ply", folder_ / "1.ply"};
    write_cloud(test::sphere(100), spec.candidate_files[0]);
    std::ofstream(spec.candidate_files[1]) << "ply\nformat ascii 1.0\nelement vertex lots\n";
    EvaluateJob job;
    job.candidates = {std::string(64, 'b'), std::string(64, 'c')};
    spec.request = {std::string(64, 'a'), job};
    std::string stage;
    EXPECT_THROW(run_job(spec,
                         [&](const JobReport& report) {
                             if (const auto* progress = std::get_if<JobProgress>(&report))
                                 stage = progress->stage;
                         }),
                 Error);
    EXPECT_EQ(stage, "decode");
}

TEST_F(Evaluation, HasTheFieldsThatMeasurementsRelyOn) {
    const json found = figures(test::sphere(3000), scaled(test::sphere(2000), 1.1F));
    for (const char* field : {"max", "mean", "rms"}) {
        EXPECT_TRUE(found.at(field).is_number());
        EXPECT_NEAR(found.at("relative").at(field).get<double>(),
                    found.at(field).get<double>() / found.at("diagonal").get<double>(), 1e-12);
    }
    for (const char* way : {"forward", "backward"}) {
        const json& direction = found.at(way);
        for (const char* field : {"max", "mean", "rms", "mean_confidence", "p50", "p95", "p99",
                                  "samples", "not_converged", "relative", "cover_radius", "max_at"})
            EXPECT_TRUE(direction.contains(field)) << way << ' ' << field;
        double sum = 0;
        for (const json& share : direction.at("histogram")) sum += share.get<double>();
        EXPECT_NEAR(sum, 1, 1e-6);
    }
    EXPECT_EQ(found.at("samples"), found.at("forward").at("samples"));
    EXPECT_EQ(found.at("reference").at("points"), 3000);
    EXPECT_EQ(found.at("candidate").at("points"), 2000);
    EXPECT_FALSE(found.contains("warnings"));
}

TEST_F(Evaluation, CountsThePointsOfBothCloudsWithoutDuplicates) {
    PointCloud reference = test::sphere(3000), candidate = test::sphere(2000);
    for (PointCloud* const cloud : {&reference, &candidate})
        for (std::size_t i = 0; i < 100; ++i) cloud->positions.push_back(cloud->positions[i]);
    const json found = figures(reference, candidate);
    EXPECT_EQ(found.at("reference").at("points"), 3000);
    EXPECT_EQ(found.at("candidate").at("points"), 2000);
}

TEST_F(Evaluation, OfALargerSphereIsTheDifferenceOfTheRadii) {
    // Both lie inside their spheres, by 1.2 / N of the squared radius or less.
    const json found = figures(test::sphere(5000), scaled(test::sphere(5000), 1.1F));
    EXPECT_NEAR(found.at("mean").get<double>(), 0.1, 0.002);
    EXPECT_NEAR(found.at("max").get<double>(), 0.1, 0.003);
    EXPECT_NEAR(found.at("backward").at("mean").get<double>(), 0.1, 0.002);
}

TEST_F(Evaluation, OfAPlaneThatIsLiftedIsTheWay) {
    const json found = figures(test::plane(4000), moved(test::plane(4000, 2), {0, 0, 0.03F}));
    EXPECT_NEAR(found.at("mean").get<double>(), 0.03, 1e-4);
    EXPECT_NEAR(found.at("rms").get<double>(), 0.03, 2e-4);
}

TEST_F(Evaluation, AMapOfASmallDentReachesItsDepth) {
    PointCloud dented = test::plane(20'000, 2);
    for (Vec3f& p : dented.positions)
        if ((p - Vec3f(0.5F, 0.5F, 0)).norm() < 0.04F) p.z() -= 0.001F;
    EvaluateJob job;
    job.output.formats = {CloudFormat::Ply};
    const json found = figures(test::plane(20'000), dented, job);
    EXPECT_LT(found.at("forward").at("p99").get<double>(), 1e-6);
    EXPECT_NEAR(found.at("range").get<double>(), found.at("max").get<double>(), 5e-4);
}

TEST_F(Evaluation, SwapsItsDirectionsWithTheClouds) {
    const PointCloud a = test::sphere(3000), b = scaled(test::sphere(1000), 1.05F);
    const json there = figures(a, b), back = figures(b, a);
    const auto same = [](const json& x, const json& y) {
        EXPECT_NEAR(x.get<double>(), y.get<double>(), 1e-6);  // floats of another frame
    };
    same(there.at("forward").at("mean"), back.at("backward").at("mean"));
    same(there.at("backward").at("max"), back.at("forward").at("max"));
    same(there.at("max"), back.at("max"));
}

TEST_F(Evaluation, OfARandomSubsetOfASphereIsNotZeroButWithThePointsAlone) {
    const PointCloud whole = test::sphere(5000);
    std::vector<Index> some;
    for (Index i = 0; i < whole.size(); i += 10) some.push_back(i);
    EXPECT_GT(figures(whole, subset(whole, some)).at("mean").get<double>(), 1e-4);
    EvaluateJob job;
    job.options.measure.surface = ErrorSurface::Samples;
    EXPECT_EQ(figures(whole, subset(whole, some), job).at("backward").at("max"), 0);
}

TEST_F(Evaluation, OfSeveralCandidatesHasEachInItsOrder) {
    const Results results =
        evaluate(test::sphere(3000), {scaled(test::sphere(3000), 1.2F), test::sphere(3000)});
    const json found = json::parse(evaluation_json(results));
    ASSERT_EQ(found.at("candidates").size(), 2U);
    EXPECT_NEAR(found["candidates"][0]["mean"].get<double>(), 0.2, 0.004);
    // Points of a sphere lie outside the linear surface, by h^2 / 2.
    EXPECT_NEAR(found["candidates"][1]["mean"].get<double>(), 0, 0.002);
    EXPECT_EQ(to_json(results_from_json(to_json(results))), to_json(results));
}

TEST_F(Evaluation, MapsHaveTheDistanceAsColourAndAsAttribute) {
    EvaluateJob job;
    job.output.formats = {CloudFormat::Ply, CloudFormat::Draco};
    job.options.range = 0.2;
    const PointCloud reference = test::sphere(2000);
    const Results results = evaluate(reference, {scaled(reference, 1.1F)}, job);
    const OutputCloud& level = results.levels.at(0);
    EXPECT_EQ(level.error->range, 0.2);
    ASSERT_EQ(level.files.size(), 2U);
    for (const OutputFile& file : level.files) {
        const PointCloud map = read_cloud(folder_ / "out" / file.href);
        ASSERT_EQ(map.size(), level.error->error.forward.samples);
        const Attribute* const distance = find_attribute(map, "distance");
        ASSERT_NE(distance, nullptr);
        const auto& values = std::get<std::vector<float>>(distance->values);
        double sum = 0;
        for (const float d : values) sum += d;
        EXPECT_NEAR(sum / static_cast<double>(values.size()), 0.1, 0.003);
        const Rgba8 middle = viridis(0.5);  // 0.1 of 0.2
        EXPECT_NEAR(map.colors.front().r, middle.r, 8);
        EXPECT_NEAR(map.colors.front().g, middle.g, 8);
        EXPECT_NEAR(map.colors.front().b, middle.b, 8);
    }
}

TEST_F(Evaluation, PicturesArePngOfTheSizeThatIsTold) {
    if (test::kSanitized) GTEST_SKIP() << "too slow under a sanitizer";
    EvaluateJob job;
    job.options.pictures = true;
    job.options.views = {"front", "top"};
    const PointCloud reference = test::sphere(2000);
    const Results results =
        evaluate(reference, {scaled(reference, 1.1F), scaled(reference, 0.9F)}, job);
    ASSERT_EQ(results.levels.at(0).pictures.size(), 1U);
    EXPECT_TRUE(results.levels.at(1).pictures.empty());
    const PictureFile& picture = results.levels[0].pictures[0];
    std::ifstream in(folder_ / "out" / picture.href, std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(in), {}};
    EXPECT_EQ(bytes.size(), picture.bytes);
    ASSERT_EQ(bytes.substr(1, 3), "PNG");
    const auto number = [&](std::size_t at) {
        unsigned value = 0;
        for (std::size_t i = at; i < at + 4; ++i)
            value = value << 8 | static_cast<unsigned char>(bytes[i]);
        return value;
    };
    EXPECT_EQ(number(16), picture.width);
    EXPECT_EQ(number(20), picture.height);
    EXPECT_EQ(results.levels[0].error->range, results.levels[1].error->range);
}

TEST_F(Evaluation, WarnsOfOtherUnitsAndOfTooFewPoints) {
    const PointCloud reference = test::sphere(3000);
    const auto units = figures(reference, scaled(test::sphere(3000), 1000)).at("warnings");
    EXPECT_NE(units.at(0).get<std::string>().find("of the reference: do both"), std::string::npos);
    const auto smaller = figures(reference, scaled(test::sphere(3000), 0.001F)).at("warnings");
    EXPECT_NE(smaller.at(0).get<std::string>().find("of the candidate: do both"),
              std::string::npos);
    const auto few = figures(reference, test::sphere(7)).at("warnings");
    EXPECT_EQ(
        few.at(0),
        "candidate of 7 points, fewer than the 20 neighbours that define a surface: distances "
        "mean little");
    PointCloud point;
    point.positions = {Vec3f::Zero()};
    const auto none = figures(point, reference);
    EXPECT_EQ(none.at("relative").at("max"), 0);
    EXPECT_NE(none.at("warnings").dump().find("coincide"), std::string::npos);
}

TEST_F(Evaluation, ACandidateThatCannotBeReadIsNamed) {
    JobSpec spec = spec_for("reference.ply");
    write_cloud(test::sphere(100), spec.input_file);
    spec.candidate_files = {spec.input_file, folder_ / "empty.ply"};
    write_cloud(PointCloud{}, folder_ / "empty.ply");
    spec.request = {std::string(64, 'a'), EvaluateJob{}};
    try {
        run(spec);
        FAIL() << "an empty cloud was compared";
    } catch (const CandidateError& error) {
        EXPECT_EQ(error.code(), ErrorCode::MalformedInput);
        EXPECT_EQ(error.number(), 2U);
        EXPECT_STREQ(error.what(), "the file holds no points");
    }
}

TEST_F(Evaluation, StandsOnEveryResultUnlessItIsRefused) {
    const PointCloud cloud = test::sphere(20'000);
    JobSpec spec = spec_for("in.ply");
    write_cloud(cloud, spec.input_file);
    SimplifyJob job;
    job.options.points = 500;
    job.output.formats = {CloudFormat::Ply};
    spec.request = {std::string(64, 'a'), job};
    const Results results = run(spec);
    const auto& error = results.levels.at(0).error;
    ASSERT_TRUE(error);
    EXPECT_GT(results.cost->error_seconds, 0);
    EXPECT_TRUE(error->error.forward.histogram.empty());

    // The same as a whole measurement finds, but for its few samples.
    const SurfaceError whole = measure_error(cloud, read_cloud(folder_ / "out" / "level-0.ply"));
    EXPECT_NEAR(error->error.mean(), whole.mean(), 0.15 * whole.mean());
    EXPECT_NEAR(error->error.backward.mean, whole.backward.mean, 0.15 * whole.backward.mean);
    EXPECT_LE(error->error.max(), 1.0001 * whole.max());
    EXPECT_GT(error->error.max(), 0.6 * whole.max());

    std::get<SimplifyJob>(spec.request.job).error = false;
    EXPECT_FALSE(run(spec).levels.at(0).error);
}

TEST_F(Evaluation, OfALevelThatIsTheWholeCloudIsZero) {
    JobSpec spec = spec_for("in.ply");
    write_cloud(test::sphere(2000, 0.01), spec.input_file);
    PyramidJob job;
    job.options.sizes = {200, 2000};
    job.output.formats = {CloudFormat::Ply};
    spec.request = {std::string(64, 'a'), job};
    const Results results = run(spec);
    EXPECT_GT(results.levels.at(0).error->error.max(), 0);
    EXPECT_EQ(results.levels.at(1).error->error.max(), 0);
    EXPECT_GT(results.levels.at(1).error->error.diagonal, 3);
}

}  // namespace
}  // namespace stipple::proto
