#pragma once

#include <cstddef>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

namespace stipple::server {

/// The bytes of a small file, shared by those that send it.
using Bytes = std::shared_ptr<const std::vector<std::byte>>;

inline Bytes shared_bytes(std::string_view text) {
    const auto bytes = std::as_bytes(std::span(text));
    return std::make_shared<const std::vector<std::byte>>(bytes.begin(), bytes.end());
}

/// Small files by name, with what else is to be known of them: those asked for last, up to a number
/// of bytes. Safe to call from any thread.
class OutputCache {
public:
    struct File {
        Bytes bytes;      ///< null: known to be absent
        std::string tag;  ///< strong entity tag, without quotes
    };

    explicit OutputCache(std::size_t max_bytes) : max_bytes_(max_bytes) {}

    std::optional<File> find(const std::string& name);
    void put(const std::string& name, File file);
    void remove(const std::string& name);

private:
    using Entries = std::list<std::pair<std::string, File>>;
    static std::size_t cost_of(const Entries::value_type& entry) noexcept;
    void remove(Entries::iterator entry);

    const std::size_t max_bytes_;
    std::mutex mutex_;  ///< for all below
    Entries entries_;   ///< the last used first
    std::unordered_map<std::string_view, Entries::iterator> by_name_;
    std::size_t bytes_ = 0;
};

}  // namespace stipple::server
