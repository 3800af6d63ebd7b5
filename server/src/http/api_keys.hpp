#pragma once

#include <cstddef>
#include <filesystem>
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

    /// No keys: everyone may do everything, as the tenant `default`.
    ApiKeys() = default;
    /// @throws Error(InvalidArgument) naming the file, the entry and what is wrong with it.
    static ApiKeys read(const std::filesystem::path& file);

    bool required() const noexcept { return !entries_.empty(); }
    std::size_t tenants() const;  ///< how many there are
    /// Takes the same time for every key.
    std::optional<Grant> find(std::string_view key) const;

private:
    struct Entry {
        std::string key_sha256;
        Grant grant;
    };
    std::vector<Entry> entries_;
};

}  // namespace stipple::server::http
