#include "http/metrics.hpp"

#include <prometheus/counter.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>
#include <prometheus/text_serializer.h>
#include <mutex>

namespace stipple::server::http {

namespace {

using prometheus::BuildCounter;
using prometheus::BuildGauge;
using prometheus::BuildHistogram;

const prometheus::Histogram::BucketBoundaries kSeconds = {0.001, 0.005, 0.02, 0.1, 0.5, 2, 10, 60};

std::string template_path(std::string_view route) {
    return std::string(route.empty() ? "none" : route);
}

}  // namespace

struct Metrics::Series {
    prometheus::Registry registry;
    prometheus::Family<prometheus::Counter>& requests = BuildCounter()
                                                            .Name("stipple_http_requests_total")
                                                            .Help("Requests answered")
                                                            .Register(registry);
    prometheus::Family<prometheus::Histogram>& durations =
        BuildHistogram()
            .Name("stipple_http_request_seconds")
            .Help("From the head of a request to the end of its reply")
            .Register(registry);
    prometheus::Family<prometheus::Counter>& bytes = BuildCounter()
                                                         .Name("stipple_http_sent_bytes_total")
                                                         .Help("Bytes of replies")
                                                         .Register(registry);
    prometheus::Family<prometheus::Counter>& refused =
        BuildCounter()
            .Name("stipple_http_refused_total")
            .Help("Requests and connections refused before a handler saw them")
            .Register(registry);
    prometheus::Family<prometheus::Gauge>& jobs =
        BuildGauge().Name("stipple_jobs").Help("Unfinished jobs").Register(registry);
    prometheus::Family<prometheus::Counter>& ended = BuildCounter()
                                                         .Name("stipple_jobs_ended_total")
                                                         .Help("Ended jobs, by outcome")
                                                         .Register(registry);
    prometheus::Family<prometheus::Counter>& attempts =
        BuildCounter()
            .Name("stipple_job_attempts_total")
            .Help("Attempts at jobs that ended in this process, by outcome")
            .Register(registry);
    std::mutex counting;  ///< those: of two scrapes at a time
    prometheus::Gauge& oldest = BuildGauge()
                                    .Name("stipple_queue_oldest_seconds")
                                    .Help("Age of the oldest waiting job")
                                    .Register(registry)
                                    .Add({});
    prometheus::Gauge& connections = BuildGauge()
                                         .Name("stipple_http_connections")
                                         .Help("Open connections")
                                         .Register(registry)
                                         .Add({});

    Series() {
        BuildGauge()
            .Name("stipple_build_info")
            .Help("The running version")
            .Register(registry)
            .Add({{"version", STIPPLE_VERSION}})
            .Set(1);
    }
};

Metrics::Metrics() : series_(std::make_unique<Series>()) {}
Metrics::~Metrics() = default;

void Metrics::request_answered(std::string_view method, std::string_view route, int status) {
    series_->requests
        .Add({{"method", std::string(method)},
              {"route", template_path(route)},
              {"status", std::to_string(status)}})
        .Increment();
}

void Metrics::request_served(std::string_view route, const Served& outcome) {
    const std::string path = template_path(route);
    series_->durations.Add({{"route", path}}, kSeconds).Observe(outcome.seconds.count());
    series_->bytes.Add({{"route", path}}).Increment(static_cast<double>(outcome.bytes));
}

void Metrics::request_refused(std::string_view reason) {
    series_->refused.Add({{"reason", std::string(reason)}}).Increment();
}

void Metrics::attempt_ended(std::string_view outcome) {
    series_->attempts.Add({{"outcome", std::string(outcome)}}).Increment();
}

void Metrics::expect_attempts(std::span<const std::string_view> outcomes) {
    for (const std::string_view outcome : outcomes)
        series_->attempts.Add({{"outcome", std::string(outcome)}});
}

std::string Metrics::text(const JobStore::Counts& queue, unsigned connections) {
    series_->jobs.Add({{"status", "accepted"}}).Set(static_cast<double>(queue.queued));
    series_->jobs.Add({{"status", "running"}}).Set(static_cast<double>(queue.running));
    for (const std::lock_guard lock(series_->counting); const auto& [status, count] : queue.ended) {
        prometheus::Counter& known = series_->ended.Add({{"status", status}});
        known.Increment(static_cast<double>(count) - known.Value());
    }
    series_->oldest.Set(queue.oldest_queued_seconds);
    series_->connections.Set(connections);
    return prometheus::TextSerializer().Serialize(series_->registry.Collect());
}

}  // namespace stipple::server::http
