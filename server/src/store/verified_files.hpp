#pragma once

#include <sys/stat.h>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <tuple>

namespace stipple::server {

/// Of which files the hash was seen to be right, as long as nobody writes to them or puts others in
/// their place. Safe to call from any thread.
class VerifiedFiles {
public:
    void add(const std::string& sha256, const struct stat& status);
    bool contains(const std::string& sha256, const struct stat& status) const;
    void remove(const std::string& sha256);

private:
    /// What changes with the file.
    using Identity = std::tuple<dev_t, ino_t, off_t, std::int64_t, std::int64_t>;
    static Identity identity_of(const struct stat& status) noexcept;

    mutable std::mutex mutex_;
    std::map<std::string, Identity> files_;
};

}  // namespace stipple::server
