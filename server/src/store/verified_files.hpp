#pragma once

#include "store/posix_file.hpp"

#include <sys/stat.h>
#include <cstddef>
#include <map>
#include <mutex>
#include <string>

namespace stipple::server {

/// Of which files the hash was seen to be right, as long as nobody writes to them or puts others in
/// their place. Safe to call from any thread. Bounded: once there are `kMost`, it forgets them all,
/// and their hashes are made again.
class VerifiedFiles {
public:
    static constexpr std::size_t kMost = 200'000;  ///< some 200 bytes each

    void add(const std::string& sha256, const struct stat& status);
    bool contains(const std::string& sha256, const struct stat& status) const;
    void remove(const std::string& sha256);

private:
    mutable std::mutex mutex_;
    std::map<std::string, FileIdentity> files_;
};

}  // namespace stipple::server
