#pragma once

#include "store/posix_file.hpp"

#include <cstddef>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stipple::server::http {

/// What a route needs. `Open` routes tell nothing of a tenant.
enum class Scope { Open, Read, Submit };

/// Who may do what. A file: a JSON list of
///
///     {"tenant": "lab", "key_sha256": "<64 hexadecimal digits>", "scopes": ["read", "submit"]}
///
/// `admin` stands for all scopes. The keys themselves are nowhere; no two entries have the same.
class ApiKeys {
public:
    struct Grant {
        std::string tenant;
        bool read = false, submit = false;
        bool allows(Scope scope) const noexcept;
    };

    /// @throws Error(InvalidArgument) naming the file, the entry and what is wrong with it.
    static ApiKeys read(const std::filesystem::path& file);

    std::size_t tenants() const noexcept { return tenants_; }  ///< how many there are
    /// Takes the same time for every key.
    std::optional<Grant> find(std::string_view key) const;

private:
    struct Entry {
        std::string key_sha256;
        Grant grant;
    };
    std::vector<Entry> entries_;
    std::size_t tenants_ = 0;
};

/// The keys of a file as it has them now: a key that is taken out of it is unknown from then on.
class ApiKeyFile {
public:
    /// @throws as `ApiKeys::read`.
    explicit ApiKeyFile(std::filesystem::path file);

    /// Those of the file, or while it is wrong, which is logged, those that it had before. Any
    /// thread; one `stat` where the file is as it was.
    std::shared_ptr<const ApiKeys> keys();

private:
    FileIdentity identity() const noexcept;

    const std::filesystem::path file_;
    std::mutex mutex_;
    FileIdentity read_from_;  ///< what was read, also where it was wrong
    std::shared_ptr<const ApiKeys> keys_;
};

}  // namespace stipple::server::http
