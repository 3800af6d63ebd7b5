#include "service/output_cache.hpp"

namespace stipple::server {

std::size_t OutputCache::cost_of(const Entries::value_type& entry) noexcept {
    constexpr std::size_t kOverhead = 256;
    return kOverhead + (entry.second.bytes ? entry.second.bytes->size() : 0);
}

std::optional<OutputCache::File> OutputCache::find(const std::string& name) {
    const std::lock_guard lock(mutex_);
    const auto found = by_name_.find(name);
    if (found == by_name_.end()) return std::nullopt;
    entries_.splice(entries_.begin(), entries_, found->second);
    return found->second->second;
}

void OutputCache::put(const std::string& name, File file) {
    const std::lock_guard lock(mutex_);
    if (const auto found = by_name_.find(name); found != by_name_.end()) remove(found->second);
    entries_.emplace_front(name, std::move(file));
    by_name_.emplace(entries_.front().first, entries_.begin());
    bytes_ += cost_of(entries_.front());
    while (bytes_ > max_bytes_) remove(std::prev(entries_.end()));
}

void OutputCache::remove(const std::string& name) {
    const std::lock_guard lock(mutex_);
    if (const auto found = by_name_.find(name); found != by_name_.end()) remove(found->second);
}

void OutputCache::remove(Entries::iterator entry) {
    bytes_ -= cost_of(*entry);
    by_name_.erase(entry->first);
    entries_.erase(entry);
}

}  // namespace stipple::server
