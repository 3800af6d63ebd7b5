#pragma once

#include "store/blob_store.hpp"
#include "store/packing.hpp"

#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <set>
#include <string>
#include <thread>

namespace stipple::server {

/// Packs stored files in the background, once for each: on one thread quickly (gzip, and Brotli's
/// quick level), on another of the lowest priority as well as Brotli can, which then takes the
/// place of its quick level. The packed copies are kept beside the blob; one that would not pay is
/// kept as no bytes, so that it is not tried again. Starts in the constructor, ends in the
/// destructor.
class Packer {
public:
    /// @param on_packed  told of each copy as it is there, from either thread.
    Packer(BlobStore& blobs,
           std::function<void(const std::string& sha256, const Packing& packing)> on_packed);
    ~Packer();

    /// Asks its threads to end. Whether they have within so long: one of the lowest priority may
    /// not see for minutes that it is to, where others have work.
    bool end(std::chrono::milliseconds patience);

    /// Asks for the copies of a blob that are not there; returns at once.
    void want(const std::string& sha256);

private:
    /// The work of a thread.
    struct Queue {
        std::deque<std::string> waiting;
        std::set<std::string> known;  ///< waiting, or in work
    };
    void put(Queue& queue, const std::string& sha256);
    void run(Queue& queue, const std::function<void(const std::string&)>& work);
    void tell_end();
    void pack_quickly(const std::string& sha256);
    void pack_best(const std::string& sha256);
    void make(const std::string& sha256, const Packing& packing);

    BlobStore& blobs_;
    const std::function<void(const std::string&, const Packing&)> on_packed_;
    std::stop_source stop_;
    std::mutex mutex_;  ///< for the queues
    std::condition_variable_any arrived_;
    Queue quick_, best_;
    unsigned running_ = 2;           ///< threads
    std::condition_variable ended_;  ///< one fewer
    std::jthread quick_thread_, best_thread_;
};

}  // namespace stipple::server
