#include "store/verified_files.hpp"

namespace stipple::server {

void VerifiedFiles::add(const std::string& sha256, const struct stat& status) {
    const std::lock_guard lock(mutex_);
    if (files_.size() >= kMost) files_.clear();
    files_.insert_or_assign(sha256, identity_of(status));
}

bool VerifiedFiles::contains(const std::string& sha256, const struct stat& status) const {
    const std::lock_guard lock(mutex_);
    const auto found = files_.find(sha256);
    return found != files_.end() && found->second == identity_of(status);
}

void VerifiedFiles::remove(const std::string& sha256) {
    const std::lock_guard lock(mutex_);
    files_.erase(sha256);
}

}  // namespace stipple::server
