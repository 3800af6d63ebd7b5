#include "service/outputs.hpp"

#include "stipple/error.hpp"
#include "stipple/proto/digest.hpp"

#include <algorithm>
#include <array>
#include <numeric>
#include <set>
#include <unordered_map>

namespace stipple::server {

namespace {

constexpr std::size_t kCacheBytes = 64U << 20;
constexpr std::size_t kMaxCachedFile = 1U << 20;
constexpr std::size_t kMaxJobs = 64;
constexpr std::uint64_t kMostInlined = 64 * 1024;  // bytes

bool is_pyramid(const proto::Results& results) {
    return std::holds_alternative<proto::PyramidJob>(results.request.job);
}

Error no_such(const std::string& what) {
    return {ErrorCode::NotFound, "no such " + what};
}

bool packs(CloudFormat format) noexcept {
    // The others are packed as well as they can be.
    return format == CloudFormat::Ply || format == CloudFormat::Glb;
}

std::string document_key(const std::string& job_id, const std::string& name,
                         const DocumentOptions& options) {
    std::string key = job_id + "/" + name + proto::tileset_query(options.tileset);
    if (options.inlined) key += "#" + std::string(to_string(*options.inlined));
    return key;
}

/// Whether a pyramid may have a document of this name: `tileset-12.json` is one. What others chose
/// becomes no part of a key of the cache.
bool is_document(std::string_view name) noexcept {
    constexpr std::string_view kStem = "tileset-", kEnd = ".json";
    if (name == "manifest.json" || name == "tileset.json") return true;
    if (!name.starts_with(kStem) || !name.ends_with(kEnd)) return false;
    name.remove_prefix(kStem.size());
    if (name.size() <= kEnd.size()) return false;
    name.remove_suffix(kEnd.size());
    return std::ranges::all_of(name, [](char c) { return '0' <= c && c <= '9'; });
}

StoredFile stored(OutputCache::File file, Coding coding, bool negotiated) {
    return {std::move(file.bytes), std::move(file.tag), coding, negotiated};
}

Error no_such_document(const std::string& name) {
    if (name == "tileset.json") return no_such("tileset: this pyramid has no tiles, or none yet");
    return no_such("file of this pyramid: " + name);
}

}  // namespace

std::optional<proto::Problem> why_incomplete(const proto::JobDocument& job) {
    if (job.status == proto::JobStatus::Dismissed)
        return proto::problem_from(ErrorCode::Conflict, "the job was dismissed before its end");
    return job.problem;
}

std::uint64_t StoredFile::size() const noexcept {
    if (const auto* const bytes = std::get_if<Bytes>(&content)) return (*bytes)->size();
    return std::get<std::shared_ptr<const BlobReader>>(content)->size();
}

struct Outputs::Job {
    struct Listed {
        std::string_view extension;
        std::uint64_t bytes = 0;
        bool packs = false;
    };
    std::string id;
    bool is_final = false;  ///< it changes no more; it can only be removed
    proto::Results results;
    std::size_t file_count = 0;
    std::unordered_map<std::string_view, Listed> files;
    mutable std::atomic<std::uint64_t> seen = 0;  ///< version of the store at which it was there
    mutable std::atomic<std::uint64_t> used = 0;
    mutable std::mutex writing;  ///< held while a document is made; for what follows
    /// Of a final job, once its tileset was written: however that is done, its files have these.
    mutable std::optional<std::set<std::string>> tileset_names;

    Job(const proto::JobDocument& document, proto::Results&& made, const Links& links)
        : id(document.id), is_final(proto::is_final(document.status)), results(std::move(made)) {
        // Who asks again and again while it is not complete learns that it never will be.
        results.problem = why_incomplete(document);
        raise_tile_errors(results);
        for (proto::OutputCloud& level : results.levels) {
            file_count += level.files.size();
            links.fill(level, id, is_pyramid(results));
            for (const proto::OutputFile& file : level.files)
                files.emplace(file.sha256,
                              Listed{to_string(file.format), file.bytes, packs(file.format)});
            for (const proto::PictureFile& picture : level.pictures)
                files.emplace(picture.sha256, Listed{kPictureExtension, picture.bytes, false});
        }
    }
};

Outputs::Outputs(JobStore& jobs, BlobStore& blobs, Links links, std::size_t max_files)
    : jobs_(jobs),
      blobs_(blobs),
      links_(std::move(links)),
      max_files_(max_files),
      cache_(kCacheBytes),
      packer_(blobs, [this](const std::string& sha256, const Packing& packing) {
          cache_.remove(sha256 + "." + std::string(to_string(packing.coding)));
      }) {}

std::shared_ptr<const proto::Results> Outputs::results(const std::string& tenant,
                                                       const std::string& id) {
    const auto job = find(tenant, id);
    return job ? std::shared_ptr<const proto::Results>(job, &job->results) : nullptr;
}

/// What became of a job that has not ended is read again once the version of the store is another.
std::shared_ptr<const Outputs::Job> Outputs::find(const std::string& tenant,
                                                  const std::string& id) {
    const std::string key = tenant + '\0' + id;
    if (auto job = remembered(key, tenant, id)) return job;
    // Of several who ask at a time, the first reads it.
    const auto mine = reading(key);
    const std::lock_guard read(*mine);
    if (auto job = remembered(key, tenant, id)) return job;

    const std::uint64_t version = jobs_.version();
    // The document first: where it is final, the results are its last.
    const auto document = jobs_.find_job(tenant, id);
    auto results = jobs_.results(tenant, id);
    if (!document || !results) return nullptr;
    auto job = std::make_shared<const Job>(*document, std::move(*results), links_);
    job->seen = version;

    const std::lock_guard lock(recent_mutex_);
    job->used = ++uses_;
    recent_.insert_or_assign(key, job);
    forget_oldest();
    return job;
}

std::shared_ptr<std::mutex> Outputs::reading(const std::string& key) {
    const std::lock_guard lock(recent_mutex_);
    std::erase_if(reading_, [](const auto& entry) { return entry.second.expired(); });
    auto mutex = reading_[key].lock();
    if (!mutex) reading_[key] = mutex = std::make_shared<std::mutex>();
    return mutex;
}

/// With the lock: until those that are left are few enough.
void Outputs::forget_oldest() {
    const auto files = [this] {
        return std::accumulate(
            recent_.begin(), recent_.end(), std::size_t{0},
            [](std::size_t sum, const auto& entry) { return sum + entry.second->file_count; });
    };
    while (recent_.size() > 1 && (recent_.size() > kMaxJobs || files() > max_files_)) {
        recent_.erase(std::ranges::min_element(
            recent_, {}, [](const auto& entry) { return entry.second->used.load(); }));
    }
}

std::shared_ptr<const Outputs::Job> Outputs::remembered(const std::string& key,
                                                        const std::string& tenant,
                                                        const std::string& id) {
    std::shared_ptr<const Job> job;
    {
        const std::lock_guard lock(recent_mutex_);
        const auto found = recent_.find(key);
        if (found == recent_.end()) return nullptr;
        job = found->second;
        job->used = ++uses_;
    }
    // What another process wrote shows a moment later; a job that goes on is read anew.
    if (!job->is_final && jobs_.is_shared()) return nullptr;
    const std::uint64_t version = jobs_.version();
    if (job->seen == version) return job;
    if (!job->is_final) return nullptr;
    if (jobs_.find_job(tenant, id)) {
        job->seen = version;
        return job;
    }
    const std::lock_guard lock(recent_mutex_);
    recent_.erase(key);
    return nullptr;
}

StoredFile Outputs::file(const std::string& tenant, const std::string& job_id,
                         const std::string& name, std::span<const Coding> accepted) {
    const auto job = find(tenant, job_id);
    if (!job) throw no_such("job: " + job_id);
    const auto dot = std::min(name.find('.'), name.size());
    const std::string sha256 = name.substr(0, dot);
    const std::string_view extension =
        std::string_view(name).substr(std::min(dot + 1, name.size()));
    const auto listed = job->files.find(sha256);
    if (listed == job->files.end() || listed->second.extension != extension)
        throw no_such("result: " + job_id + "/" + name);
    const bool negotiated = listed->second.packs && listed->second.bytes <= kMaxPackedSource;
    for (const Coding coding : accepted) {
        if (!negotiated || coding == Coding::Identity) break;
        if (auto file = packed(sha256, coding)) return stored(std::move(*file), coding, true);
    }

    if (auto file = cache_.find(sha256))
        return stored(std::move(*file), Coding::Identity, negotiated);
    auto blob = open(sha256);
    if (blob->size() > kMaxCachedFile)
        return {std::move(blob), sha256, Coding::Identity, negotiated};
    OutputCache::File file{std::make_shared<const std::vector<std::byte>>(read_all(*blob)), sha256};
    cache_.put(sha256, file);
    return stored(std::move(file), Coding::Identity, negotiated);
}

std::shared_ptr<const BlobReader> Outputs::open(const std::string& sha256) const {
    auto blob = blobs_.open(sha256);
    if (!blob) throw Error(ErrorCode::Internal, "result " + sha256 + ": its bytes are missing");
    return blob;
}

std::optional<OutputCache::File> Outputs::packed(const std::string& sha256, Coding coding) {
    static constexpr std::array kBrotlis = {kBestBrotli, kQuickBrotli};
    static constexpr std::array kGzips = {kGzip};
    const std::string key = sha256 + "." + std::string(to_string(coding));
    auto file = cache_.find(key);
    const auto& packings = coding == Coding::Brotli ? std::span<const Packing>(kBrotlis) : kGzips;
    for (std::size_t i = 0; !file && i < packings.size(); ++i) {
        const auto copy = blobs_.copy(sha256, packings[i].name);
        if (!copy) {
            packer_.want(sha256);
            continue;
        }
        file.emplace(OutputCache::File{{}, sha256 + "-" + std::string(packings[i].name)});
        if (!copy->empty()) file->bytes = std::make_shared<const std::vector<std::byte>>(*copy);
        cache_.put(key, *file);
    }
    return file && file->bytes ? file : std::nullopt;
}

StoredFile Outputs::document(const std::string& tenant, const std::string& job_id,
                             const std::string& name, std::span<const Coding> accepted,
                             const DocumentOptions& options, const Turn& turn) {
    const auto job = find(tenant, job_id);
    if (!job || !is_pyramid(job->results)) throw no_such("pyramid: " + job_id);
    if (!is_document(name)) throw no_such_document(name);
    std::shared_ptr<void> mine;
    const auto begin = [&] {
        if (turn && !mine) mine = turn();
    };
    if (!job->is_final) {
        OutputCache::File file = plain_document(*job, name, options, begin);
        if (file.bytes->size() > kMaxCachedFile)
            return {hold(*file.bytes), std::move(file.tag), Coding::Identity, true};
        return stored(std::move(file), Coding::Identity, true);
    }

    const std::string key = document_key(job_id, name, options);
    for (const Coding coding : accepted) {
        if (coding == Coding::Identity) break;
        const std::string packed_key = key + "." + std::string(to_string(coding));
        auto file = cache_.find(packed_key);
        if (!file) {
            const OutputCache::File plain = plain_document(*job, name, options, begin);
            begin();
            const Packing& packing = coding == Coding::Brotli ? kQuickBrotli : kGzip;
            file.emplace(OutputCache::File{{}, plain.tag + "-" + std::string(packing.name)});
            if (auto bytes = pack(*plain.bytes, packing))
                file->bytes = std::make_shared<const std::vector<std::byte>>(std::move(*bytes));
            cache_.put(packed_key, *file);
        }
        if (file->bytes) return stored(std::move(*file), coding, true);
    }
    return stored(plain_document(*job, name, options, begin), Coding::Identity, true);
}

/// A tileset is written as a whole. Of a job that has ended all its files are kept, some 25 MB of
/// the largest: who walks through them has them written once.
OutputCache::File Outputs::plain_document(const Job& job, const std::string& name,
                                          const DocumentOptions& options,
                                          const std::function<void()>& begin) {
    const bool is_manifest = name == "manifest.json";
    const std::string key = document_key(job.id, name, options);
    const auto known = [&] { return job.is_final ? cache_.find(key) : std::nullopt; };
    if (auto file = known()) return *file;
    begin();
    const std::lock_guard lock(job.writing);  // of several who ask at a time, the first has it made
    if (auto file = known()) return *file;
    if (job.is_final && !is_manifest && job.tileset_names && !job.tileset_names->contains(name))
        throw no_such_document(name);
    const proto::Results changed =
        options.inlined ? with_coarsest_inside(job.results, *options.inlined) : proto::Results{};
    const proto::Results& results = options.inlined ? changed : job.results;
    std::optional<OutputCache::File> wanted;
    const auto add = [&](const std::string& its_name, std::string_view text) {
        if (!job.is_final && its_name != name) return;
        OutputCache::File file{shared_bytes(text),
                               proto::sha256_hex(std::as_bytes(std::span(text)))};
        if (job.is_final) cache_.put(document_key(job.id, its_name, options), file);
        if (its_name == name) wanted = std::move(file);
    };
    if (is_manifest) {
        add(name, proto::to_json(results));
    } else {
        std::set<std::string> names;
        for (const proto::TilesetFile& file : proto::tileset_files(results, options.tileset)) {
            add(file.name, file.json);
            names.insert(file.name);
        }
        if (job.is_final) job.tileset_names = std::move(names);
    }
    if (!wanted) throw no_such_document(name);
    return *wanted;
}

proto::Results Outputs::with_coarsest_inside(proto::Results results, CloudFormat format) const {
    if (results.levels.empty()) return results;
    std::uint64_t bytes = 0;
    for (proto::OutputFile& file : results.levels.front().files) {
        if (file.format != format) continue;
        bytes += file.bytes;
        if (bytes > kMostInlined) break;
        file.href = "data:" + std::string(media_type(format)) + ";base64," +
                    proto::base64(read_all(*open(file.sha256)));
    }
    return results;
}

void Outputs::announce(const proto::OutputCloud& level) {
    for (const proto::OutputFile& file : level.files)
        if (file.tile) packer_.want(file.sha256);
}

}  // namespace stipple::server
