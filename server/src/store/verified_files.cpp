#include "store/verified_files.hpp"

namespace stipple::server {

void VerifiedFiles::add(const std::string& sha256, const struct stat& status) {
    const std::lock_guard lock(mutex_);
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

VerifiedFiles::Identity VerifiedFiles::identity_of(const struct stat& status) noexcept {
    return {status.st_dev, status.st_ino, status.st_size, status.st_ctim.tv_sec,
            status.st_ctim.tv_nsec};
}

}  // namespace stipple::server
