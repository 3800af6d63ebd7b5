#pragma once

#include "service/service.hpp"
#include "support/expect_error.hpp"
#include "support/ply_text.hpp"
#include "support/support.hpp"
#include "worker/worker_pool.hpp"

#include "stipple/proto/digest.hpp"

#include <spdlog/sinks/ostream_sink.h>
#include <spdlog/spdlog.h>
#include <functional>
#include <memory>
#include <sstream>
#include <string>
#include <string_view>

namespace stipple::test {

inline std::string text_of(const server::BlobReader& blob) {
    std::string text(blob.size(), '\0');
    text.resize(blob.read(0, std::as_writable_bytes(std::span(text))));
    return text;
}

inline std::string put_blob(server::BlobStore& blobs, std::string_view text) {
    const auto writer = blobs.create(text.size());
    writer->write(bytes_of(text));
    return writer->commit();
}

/// The row of a cloud; its bytes only matter to those who read them.
inline std::string put_cloud(server::JobStore& jobs, const std::string& tenant,
                             std::string_view text) {
    const std::string id = proto::sha256_hex(bytes_of(text));
    jobs.put_cloud({.tenant = tenant,
                    .id = id,
                    .name = {},
                    .format = CloudFormat::Ply,
                    .bytes = text.size(),
                    .created = {},
                    .statistics = {}});
    return id;
}

inline proto::JobRequest simplify_request(const std::string& input, std::uint64_t points = 100) {
    proto::SimplifyJob job;
    job.options.points = points;
    return {input, job};
}

inline proto::JobRequest pyramid_request(const std::string& input) {
    return {input, proto::PyramidJob{}};
}

inline proto::CloudStatistics statistics_of(std::uint64_t points) {
    proto::CloudStatistics statistics;
    statistics.points = points;
    statistics.bounds = {Vec3d::Zero(), Vec3d::Ones()};
    statistics.encoding = "ascii";
    return statistics;
}

inline proto::OutputCloud level_with(unsigned level, const std::string& sha256,
                                     std::uint64_t points = 10) {
    return {.level = level,
            .points = points,
            .spacing = 0.5,
            .bounds = {Vec3d::Zero(), Vec3d::Ones()},
            .files = {{CloudFormat::Ply, 100, sha256, ""}}};
}

inline proto::JobReport progress_report(const std::string& stage, double percent) {
    return proto::JobProgress{stage, percent};
}

inline proto::JobReport cost_report() {
    return proto::JobCost{.total_seconds = 1, .threads = 1};
}

/// A job that is a function.
class FunctionRunner final : public server::JobRunner {
public:
    using Report = std::function<void(const proto::JobReport&)>;
    using Function = std::function<Outcome(const proto::JobSpec&, const Report&, std::stop_token)>;

    explicit FunctionRunner(Function function) : function_(std::move(function)) {}
    Outcome run(const proto::JobSpec& spec, const Report& report, std::stop_token stop) override {
        return function_(spec, report, std::move(stop));
    }

private:
    const Function function_;
};

/// What is logged while it lives; to be read when all who log have ended.
class Log {
public:
    Log() {
        const auto sink = std::make_shared<spdlog::sinks::ostream_sink_mt>(text_);
        spdlog::set_default_logger(std::make_shared<spdlog::logger>("test", sink));
    }
    ~Log() { spdlog::set_default_logger(before_); }
    Log(const Log&) = delete;
    Log& operator=(const Log&) = delete;
    std::string text() const { return text_.str(); }

private:
    std::ostringstream text_;
    std::shared_ptr<spdlog::logger> before_ = spdlog::default_logger();
};

}  // namespace stipple::test
