#include "cli/job_execution.hpp"

#include "cli/files.hpp"
#include "cli/text.hpp"
#include "stipple/error.hpp"
#include "stipple/proto/digest.hpp"
#include "stipple/proto/pyramid_export.hpp"
#include "stipple/proto/run_job.hpp"

#include <sys/resource.h>
#include <algorithm>

namespace stipple::cli {
namespace {

namespace fs = std::filesystem;

/// As `ulimit -f` sets it; 0 where nothing is set.
std::uint64_t most_bytes_of_a_file() {
    rlimit limit{};
    const bool limited = ::getrlimit(RLIMIT_FSIZE, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY;
    return limited ? limit.rlim_cur : 0;
}

proto::Results execute_here(const proto::JobRequest& request, const fs::path& input,
                            const fs::path& folder, const JobExecution& execution,
                            ProgressDisplay& display) {
    proto::JobSpec spec;
    spec.request = request;
    spec.input_file = input.string();
    for (const fs::path& candidate : execution.candidates)
        spec.candidate_files.push_back(candidate.string());
    spec.output_dir = folder.string();
    spec.limits = limits_here();
    spec.threads = execution.threads;
    spec.max_file_bytes = most_bytes_of_a_file();

    proto::Results results;
    results.request = request;
    const auto collect = [&](const proto::JobReport& report) {
        if (const auto* const progress = std::get_if<proto::JobProgress>(&report))
            display.update(progress->stage, progress->percent / 100);
        else if (const auto* const source = std::get_if<proto::CloudStatistics>(&report))
            results.source = *source;
        else if (const auto* const level = std::get_if<proto::OutputCloud>(&report))
            results.levels.push_back(*level);
        else if (const auto* const cost = std::get_if<proto::JobCost>(&report))
            results.cost = *cost;
    };
    RunContext context;
    context.stop = execution.stop;
    try {
        proto::run_job(spec, collect, context);
    } catch (const proto::StorageFull&) {
        // It names a file that is not there any more, in a folder that the user did not name.
        throw Error(ErrorCode::Internal, folder.parent_path().string() +
                                             ": no space is left on the disk of this folder");
    }
    results.complete = true;
    return results;
}

/// What a server's progress event says.
void show(const ClientEvent& event, double from, double to, ProgressDisplay& display) {
    if (event.type != "progress") return;
    const proto::JobReport report = proto::job_report_from_json(event.data);
    const auto* const progress = std::get_if<proto::JobProgress>(&report);
    if (progress == nullptr) return;
    display.update(printable(progress->stage), from + (to - from) * progress->percent / 100);
}

/// As a job here would have failed.
[[noreturn]] void raise(const proto::Problem& problem) {
    const Error error = proto::error_from(problem);
    if (problem.candidate) throw proto::CandidateError(*problem.candidate, error);
    throw error;
}

/// Nobody waits for it any more: the server need not go on. What fails here was said already.
void dismiss_quietly(const ServerOptions& server, const std::string& job) {
    try {
        Client(server.url,
               {.api_key = server.api_key, .stop = {}, .timeout = std::chrono::seconds(5)})
            .dismiss(job);
    } catch (const std::exception&) {
    }
}

/// Files named as a job here names them, so that the rest need not know where it ran.
void fetch_levels(Client& client, proto::Results& results, const fs::path& folder, double from,
                  ProgressDisplay& display) {
    std::uint64_t all = 1, fetched = 0;
    for (const proto::OutputCloud& level : results.levels)
        for (const proto::OutputFile& file : level.files) all += file.bytes;
    // A picture is small beside clouds, and has no other job's name.
    for (proto::OutputCloud& level : results.levels) {
        for (proto::PictureFile& picture : level.pictures) {
            client.download({{}, picture.bytes, picture.sha256, picture.href},
                            folder / "picture.png");
            picture.href = "picture.png";
        }
    }
    for (proto::OutputCloud& level : results.levels) {
        for (proto::OutputFile& file : level.files) {
            const std::string name = proto::file_name(level, file);
            client.download(file, folder / name, [&](std::uint64_t done, std::uint64_t) {
                const double share = static_cast<double>(fetched + done) / static_cast<double>(all);
                display.update("download", from + (1 - from) * share);
            });
            fetched += file.bytes;
            file.href = name;
        }
    }
}

proto::Results execute_there(proto::JobRequest request, const fs::path& input,
                             const fs::path& folder, const JobExecution& execution,
                             ProgressDisplay& display) {
    constexpr double kUploaded = 0.25,
                     kComputed = 0.9;  // of all the work, for want of better knowledge
    const ServerOptions& server = execution.server;
    Client client(
        server.url,
        {.api_key = server.api_key, .stop = execution.stop, .timeout = std::chrono::seconds(60)});
    display.update("upload", 0);
    const proto::CloudDocument cloud =
        client.upload(input, [&](std::uint64_t done, std::uint64_t all) {
            const double share =
                static_cast<double>(done) / static_cast<double>(std::max<std::uint64_t>(all, 1));
            display.update("upload", kUploaded * share);
        });
    request.input = cloud.id;
    if (auto* const job = std::get_if<proto::EvaluateJob>(&request.job)) {
        job->candidates.clear();
        for (const fs::path& candidate : execution.candidates)
            job->candidates.push_back(client.upload(candidate).id);
    }

    const std::string job = client.submit(request).id;
    try {
        display.update("queued", kUploaded);
        const proto::JobDocument document = client.follow(
            job, [&](const ClientEvent& event) { show(event, kUploaded, kComputed, display); });
        if (document.problem) raise(*document.problem);
        if (document.status == proto::JobStatus::Dismissed)
            throw Error(ErrorCode::Conflict, "job " + job + " was dismissed on the server");
        proto::Results results = client.results(job);
        fetch_levels(client, results, folder, kComputed, display);
        return results;
    } catch (const Cancelled&) {
        dismiss_quietly(server, job);
        throw;
    }
}

}  // namespace

proto::Results execute(proto::JobRequest request, const fs::path& input, const fs::path& folder,
                       const JobExecution& execution, ProgressDisplay& display) {
    if (execution.server.url.empty())
        return execute_here(request, input, folder, execution, display);
    return naming_key(
        [&] { return execute_there(std::move(request), input, folder, execution, display); });
}

}  // namespace stipple::cli
