#include "service/packer.hpp"

#include "log_text.hpp"

#include <spdlog/spdlog.h>
#include <sys/resource.h>
#include <unistd.h>

namespace stipple::server {

namespace {

/// More are forgotten: who asks for such a file asks for its copies again.
constexpr std::size_t kMaxWaiting = 100'000;
constexpr int kLowestPriority = 19;

}  // namespace

Packer::Packer(BlobStore& blobs, std::function<void(const std::string&, const Packing&)> on_packed)
    : blobs_(blobs), on_packed_(std::move(on_packed)) {
    quick_thread_ = std::jthread([this] {
        run(quick_, [this](const std::string& sha256) { pack_quickly(sha256); });
        tell_end();
    });
    best_thread_ = std::jthread([this] {
        // Of this thread alone, as Linux has it.
        ::setpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()), kLowestPriority);
        run(best_, [this](const std::string& sha256) { pack_best(sha256); });
        tell_end();
    });
}

Packer::~Packer() {
    stop_.request_stop();
}

bool Packer::end(std::chrono::milliseconds patience) {
    stop_.request_stop();
    std::unique_lock lock(mutex_);
    return ended_.wait_for(lock, patience, [this] { return running_ == 0; });
}

void Packer::want(const std::string& sha256) {
    put(quick_, sha256);
}

void Packer::put(Queue& queue, const std::string& sha256) {
    {
        const std::lock_guard lock(mutex_);
        if (queue.waiting.size() >= kMaxWaiting || !queue.known.insert(sha256).second) return;
        queue.waiting.push_back(sha256);
    }
    arrived_.notify_all();
}

void Packer::run(Queue& queue, const std::function<void(const std::string&)>& work) {
    const std::stop_token stop = stop_.get_token();
    while (true) {
        std::string sha256;
        {
            std::unique_lock lock(mutex_);
            if (!arrived_.wait(lock, stop, [&] { return !queue.waiting.empty(); })) return;
            if (stop.stop_requested()) return;
            sha256 = std::move(queue.waiting.front());
            queue.waiting.pop_front();
        }
        try {
            work(sha256);
        } catch (const std::exception& error) {
            // It is sent as it is.
            spdlog::warn("packer.failed sha256={} error={}", sha256, log_text(error.what()));
        }
        const std::lock_guard lock(mutex_);
        queue.known.erase(sha256);
    }
}

void Packer::tell_end() {
    const std::lock_guard lock(mutex_);
    --running_;
    ended_.notify_all();
}

void Packer::pack_quickly(const std::string& sha256) {
    const bool best = blobs_.copy(sha256, kBestBrotli.name).has_value();
    if (!best) make(sha256, kQuickBrotli);
    make(sha256, kGzip);
    if (!best) put(best_, sha256);
}

void Packer::pack_best(const std::string& sha256) {
    make(sha256, kBestBrotli);
    blobs_.remove_copy(sha256, kQuickBrotli.name);
}

void Packer::make(const std::string& sha256, const Packing& packing) {
    if (blobs_.copy(sha256, packing.name)) return;
    const auto blob = blobs_.open(sha256);
    if (!blob || blob->size() > kMaxPackedSource) return;
    const auto packed = pack(read_all(*blob), packing, stop_.get_token());
    if (stop_.stop_requested()) return;
    blobs_.put_copy(sha256, packing.name, packed.value_or(std::vector<std::byte>{}));
    on_packed_(sha256, packing);
}

}  // namespace stipple::server
