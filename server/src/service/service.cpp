#include "service/service.hpp"

#include "stipple/error.hpp"
#include "stipple/proto/digest.hpp"
#include "stipple/proto/idempotency_key.hpp"

#include <algorithm>
#include <utility>

namespace stipple::server {

namespace {

using std::chrono::steady_clock;

constexpr unsigned kMaxPage = 1000;
constexpr std::size_t kLargeEvent = 1U << 16;
constexpr std::size_t kLargeEventBytes = 32U << 20;  // kept in memory

Error no_such(const char* what, const std::string& id) {
    return {ErrorCode::NotFound, std::string("no such ") + what + ": " + id};
}

void check_page(unsigned limit) {
    if (limit >= 1 && limit <= kMaxPage) return;
    throw Error(ErrorCode::InvalidArgument,
                "limit " + std::to_string(limit) + ": expected 1.." + std::to_string(kMaxPage));
}

bool is_pyramid(const proto::JobRequest& request) {
    return std::holds_alternative<proto::PyramidJob>(request.job);
}

/// What earlier jobs found out about the input: a job that could only fail is refused at once.
void check_known_cloud(const proto::CloudStatistics& cloud, const Limits& limits) {
    if (cloud.points > limits.decode.max_points) {
        throw Error(ErrorCode::TooLarge, "the input has " + std::to_string(cloud.points) +
                                             " points: the limit is " +
                                             std::to_string(limits.decode.max_points));
    }
    if (cloud.points == cloud.non_finite) {
        throw Error(ErrorCode::MalformedInput,
                    "the input has no point with finite coordinates: expected at least 1");
    }
}

}  // namespace

Service::Service(Limits limits, JobStore& jobs, BlobStore& blobs, Links links)
    : limits_(std::move(limits)),
      jobs_(jobs),
      blobs_(blobs),
      links_(std::move(links)),
      outputs_(jobs, blobs, links_),
      large_events_(kLargeEventBytes) {}

void Service::fill_links(proto::JobDocument& job) const {
    job.links = links_.of_job(job.id, job.request);
}

proto::JobDocument Service::with_links(proto::JobDocument job) const {
    fill_links(job);
    return job;
}

proto::CloudDocument Service::document_of(CloudRow row) const {
    std::vector<proto::Link> links = links_.of_cloud(row.id, row.format);
    return {.id = row.id,
            .name = std::move(row.name),
            .format = row.format,
            .bytes = row.bytes,
            .created = std::move(row.created),
            .statistics = std::move(row.statistics),
            .links = std::move(links)};
}

/// Fills in the links of an event that tells of a level. A level of many tiles takes a second and
/// ten times its bytes: such are filled in one at a time, and once for all who follow the job.
void Service::fill_links(JobEvent& event, const proto::JobDocument& job) {
    if (event.type != "level") return;
    const bool large = event.data.size() > kLargeEvent;
    const std::string key = job.id + '/' + std::to_string(event.id);
    const auto lock = large ? std::unique_lock(filling_) : std::unique_lock<std::mutex>();
    if (const auto known = large ? large_events_.find(key) : std::nullopt) {
        event.shared = known->bytes;
        event.data = {};
        return;
    }
    proto::JobReport report = proto::job_report_from_json(event.data);
    links_.fill(std::get<proto::OutputCloud>(report), job.id, is_pyramid(job.request));
    event.data = to_json(report);
    if (!large) return;
    event.shared = shared_bytes(std::exchange(event.data, {}));
    large_events_.put(key, {event.shared, {}});
}

// Clouds.

std::unique_ptr<BlobWriter> Service::begin_upload() {
    return blobs_.create(limits_.max_upload_bytes);
}

Submission<proto::CloudDocument> Service::finish_upload(const std::string& tenant,
                                                        BlobWriter& upload,
                                                        std::span<const std::byte> head,
                                                        const std::optional<std::string>& name) {
    const std::uint64_t bytes = upload.size();
    const CloudFormat format = check_head(head, bytes, limits_.decode);
    const std::string id = upload.commit();
    const Submitted submitted = jobs_.put_cloud({.tenant = tenant,
                                                 .id = id,
                                                 .name = name,
                                                 .format = format,
                                                 .bytes = bytes,
                                                 .created = {},
                                                 .statistics = {}});
    return {cloud(tenant, id), submitted == Submitted::Existing};
}

proto::CloudDocument Service::cloud(const std::string& tenant, const std::string& id) {
    auto row = jobs_.find_cloud(tenant, id);
    if (!row) throw no_such("cloud", id);
    return document_of(std::move(*row));
}

Page<proto::CloudDocument> Service::clouds(const std::string& tenant, unsigned limit,
                                           const std::optional<std::string>& cursor) {
    check_page(limit);
    Page<CloudRow> rows = jobs_.list_clouds(tenant, limit, cursor);
    Page<proto::CloudDocument> page{{}, std::move(rows.next)};
    for (CloudRow& row : rows.items) page.items.push_back(document_of(std::move(row)));
    return page;
}

std::shared_ptr<const BlobReader> Service::cloud_content(const std::string& tenant,
                                                         const std::string& id) {
    if (!jobs_.find_cloud(tenant, id)) throw no_such("cloud", id);
    auto blob = blobs_.open(id);
    if (!blob) throw Error(ErrorCode::Internal, "cloud " + id + ": its bytes are missing");
    return blob;
}

void Service::remove_cloud(const std::string& tenant, const std::string& id) {
    if (!jobs_.remove_cloud(tenant, id)) throw no_such("cloud", id);
}

// Jobs.

Submission<proto::JobDocument> Service::submit(const std::string& tenant,
                                               const proto::JobRequest& request,
                                               const std::optional<std::string>& idempotency_key) {
    if (idempotency_key) {
        proto::check_idempotency_key(*idempotency_key);
        // Before all that may have changed since: who repeats a request learns of its job.
        if (auto known = jobs_.find_submitted(tenant, request, *idempotency_key))
            return {with_links(std::move(*known)), true};
    }
    if (const auto* const upsampling = std::get_if<proto::UpsampleJob>(&request.job);
        upsampling != nullptr && upsampling->options.points > limits_.decode.max_points)
        throw Error(ErrorCode::TooLarge, "points " + std::to_string(*upsampling->options.points) +
                                             ": the limit is " +
                                             std::to_string(limits_.decode.max_points));
    std::visit([](const auto& job) { validate(job.options); }, request.job);
    const auto input = jobs_.find_cloud(tenant, request.input);
    if (input && input->statistics) check_known_cloud(*input->statistics, limits_);

    blobs_.check_room();

    auto submission = jobs_.submit(tenant, request, idempotency_key, limits_.queue);
    fill_links(submission.document);
    return submission;
}

proto::JobDocument Service::job(const std::string& tenant, const std::string& id) {
    auto document = jobs_.find_job(tenant, id);
    if (!document) throw no_such("job", id);
    return with_links(std::move(*document));
}

proto::JobDocument Service::wait_for_job(const std::string& tenant, const std::string& id,
                                         std::chrono::milliseconds wait, std::stop_token stop) {
    const auto deadline =
        steady_clock::now() + std::min<std::chrono::milliseconds>(wait, limits_.max_wait);
    while (true) {
        // Taken before the look at the job: a change after it ends the wait at once.
        const std::uint64_t seen = jobs_.version();
        proto::JobDocument document = job(tenant, id);
        if (is_final(document.status) || steady_clock::now() >= deadline || stop.stop_requested()) {
            return document;
        }
        jobs_.wait_for_change(seen, deadline, stop);
    }
}

Page<proto::JobDocument> Service::jobs(const std::string& tenant, const JobStore::JobFilter& filter,
                                       unsigned limit, const std::optional<std::string>& cursor) {
    check_page(limit);
    auto page = jobs_.list_jobs(tenant, filter, limit, cursor);
    for (proto::JobDocument& document : page.items) fill_links(document);
    return page;
}

proto::JobDocument Service::dismiss(const std::string& tenant, const std::string& id) {
    auto document = jobs_.dismiss(tenant, id);
    if (!document) throw no_such("job", id);
    return with_links(std::move(*document));
}

proto::JobDocument Service::cancel(const std::string& tenant, const std::string& id) {
    auto document = jobs_.cancel(tenant, id);
    if (!document) throw no_such("job", id);
    return with_links(std::move(*document));
}

Service::JobEvents Service::events(const std::string& tenant, const std::string& id,
                                   std::uint64_t after, std::chrono::milliseconds wait,
                                   std::stop_token stop) {
    const auto deadline =
        steady_clock::now() + std::min<std::chrono::milliseconds>(wait, limits_.max_wait);
    while (true) {
        const std::uint64_t seen = jobs_.version();
        // The document first: once it is final, every event is there.
        const proto::JobDocument document = job(tenant, id);
        JobEvents events{jobs_.events_after(tenant, id, after)};
        events.complete = is_final(document.status) && events.items.empty();
        if (!events.items.empty() || events.complete || steady_clock::now() >= deadline ||
            stop.stop_requested()) {
            for (JobEvent& event : events.items) fill_links(event, document);
            return events;
        }
        jobs_.wait_for_change(seen, deadline, stop);
    }
}

bool Service::has_events(const std::string& tenant, const std::string& id, std::uint64_t after) {
    return !jobs_.events_after(tenant, id, after).empty();
}

// Results.

std::shared_ptr<const proto::Results> Service::results(const std::string& tenant,
                                                       const std::string& id) {
    auto results = outputs_.results(tenant, id);
    if (!results) throw no_such("job", id);
    return results;
}

void Service::check_ready() {
    jobs_.probe();
    blobs_.probe();
}

}  // namespace stipple::server
