#include "http/api_keys.hpp"

#include "log_text.hpp"

#include "stipple/error.hpp"
#include "stipple/proto/digest.hpp"

#include <sys/stat.h>

#include <spdlog/spdlog.h>
#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <set>
#include <span>
#include <system_error>

namespace stipple::server::http {

namespace {

using Json = nlohmann::json;

/// Looks at every character whatever it finds.
bool equal_in_constant_time(std::string_view a, std::string_view b) noexcept {
    if (a.size() != b.size()) return false;
    unsigned char difference = 0;
    for (std::size_t i = 0; i < a.size(); ++i)
        difference |= static_cast<unsigned char>(a[i] ^ b[i]);
    return difference == 0;
}

constexpr const char* kExample =
    R"({"tenant": "lab", "key_sha256": "...", "scopes": ["read", "submit"]})";

Error invalid(const std::string& why) {
    return {ErrorCode::InvalidArgument, why};
}

/// The field of an entry. @throws Error when there is none of this type.
const Json& field(const Json& entry, const char* name, Json::value_t type, const char* expected) {
    const auto found = entry.find(name);
    if (found == entry.end())
        throw invalid(std::string(name) + " is missing: expected " + expected);
    if (found->type() != type)
        throw invalid(std::string(name) + " " + found->dump() + ": expected " + expected);
    return *found;
}

void grant_scope(ApiKeys::Grant& grant, const Json& scope) {
    if (scope != "read" && scope != "submit" && scope != "admin")
        throw invalid("scope " + scope.dump() + ": expected \"read\", \"submit\" or \"admin\"");
    if (scope != "submit") grant.read = true;
    if (scope != "read") grant.submit = true;
}

ApiKeys::Grant read_grant(const Json& entry) {
    ApiKeys::Grant grant{.tenant = field(entry, "tenant", Json::value_t::string, "a name")};
    if (grant.tenant.empty()) throw invalid("tenant is empty: expected a name");
    if (std::ranges::any_of(grant.tenant,
                            [](char c) { return (c >= 0 && c < ' ') || c == '\x7f'; }))
        throw invalid("tenant has control characters: expected a name without");
    const Json& scopes =
        field(entry, "scopes", Json::value_t::array, "a list of read, submit or admin");
    if (scopes.empty())
        throw invalid("scopes is empty: give read, submit or admin, or remove the entry");
    for (const Json& scope : scopes) grant_scope(grant, scope);
    // One that is meant to restrict the key must not count for nothing.
    for (const auto& [name, value] : entry.items())
        if (name != "tenant" && name != "scopes" && name != "key_sha256")
            throw invalid(name + ": no such field: expected tenant, key_sha256 and scopes");
    return grant;
}

std::string read_hash(const Json& entry) {
    constexpr const char* kRemedy = "what `printf %s KEY | sha256sum` prints";
    std::string hash = field(entry, "key_sha256", Json::value_t::string, kRemedy);
    if (!proto::is_sha256(hash))
        throw invalid(std::string("key_sha256 is not 64 lower-case hexadecimal digits: expected ") +
                      kRemedy);
    if (hash == proto::sha256_hex({}))
        throw invalid(std::string("key_sha256 is that of an empty key: expected ") + kRemedy);
    return hash;
}

std::string read_text(const std::filesystem::path& file) {
    std::error_code none;  // what there is of it, opening it says
    if (std::filesystem::is_directory(file, none))
        throw invalid("is a folder: expected a JSON file");
    std::ifstream in(file);
    if (!in) throw invalid(std::string("cannot be read: ") + std::strerror(errno));
    return {std::istreambuf_iterator<char>(in), {}};
}

Json parse(const std::string& text) {
    try {
        return Json::parse(text);
    } catch (const Json::parse_error& error) {
        const auto line = std::ranges::count(text.substr(0, error.byte), '\n') + 1;
        throw invalid("is not JSON from line " + std::to_string(line) + " on: expected a list of " +
                      kExample);
    }
}

/// "entry 2 (tenant lab)", as far as it has one.
std::string name_of(const Json& entry, std::size_t number) {
    const std::string name = "entry " + std::to_string(number);
    const auto tenant = entry.is_object() ? entry.find("tenant") : entry.end();
    return tenant == entry.end() || !tenant->is_string()
               ? name
               : name + " (tenant " + tenant->get<std::string>() + ")";
}

}  // namespace

bool ApiKeys::Grant::allows(Scope scope) const noexcept {
    return scope == Scope::Open || (scope == Scope::Read && read) ||
           (scope == Scope::Submit && submit);
}

ApiKeys ApiKeys::read(const std::filesystem::path& file) {
    ApiKeys keys;
    std::string at;
    try {
        const Json list = parse(read_text(file));
        if (!list.is_array() || list.empty())
            throw invalid(std::string("has no key: expected a list of ") + kExample);
        for (const Json& json : list) {
            at = name_of(json, keys.entries_.size() + 1) + ": ";
            if (!json.is_object()) throw invalid(std::string("expected ") + kExample);
            const Entry entry{read_hash(json), read_grant(json)};
            for (const Entry& other : keys.entries_) {
                if (other.key_sha256 == entry.key_sha256)
                    throw invalid("key_sha256 is also that of an entry of tenant " +
                                  other.grant.tenant + ": give each entry its own key");
            }
            keys.entries_.push_back(entry);
        }
        std::set<std::string_view> tenants;
        for (const Entry& entry : keys.entries_) tenants.insert(entry.grant.tenant);
        keys.tenants_ = tenants.size();
    } catch (const Error& error) {
        throw invalid("--api-keys " + file.string() + ": " + at + error.what());
    }
    return keys;
}

std::optional<ApiKeys::Grant> ApiKeys::find(std::string_view key) const {
    const std::string hash = proto::sha256_hex(std::as_bytes(std::span(key)));
    const Entry* found = nullptr;
    for (const Entry& entry : entries_)
        if (equal_in_constant_time(entry.key_sha256, hash)) found = &entry;
    return found != nullptr ? std::optional(found->grant) : std::nullopt;
}

ApiKeyFile::ApiKeyFile(std::filesystem::path file)
    : file_(std::move(file)),
      read_from_(identity()),
      keys_(std::make_shared<const ApiKeys>(ApiKeys::read(file_))) {}

std::shared_ptr<const ApiKeys> ApiKeyFile::keys() {
    const std::lock_guard lock(mutex_);
    const FileIdentity now = identity();
    if (now == read_from_) return keys_;
    read_from_ = now;  // before it is read: what is written meanwhile is read the next time
    try {
        keys_ = std::make_shared<const ApiKeys>(ApiKeys::read(file_));
        spdlog::info("keys.read tenants={}", keys_->tenants());
    } catch (const Error& error) {
        spdlog::error("keys.failed error={} effect=\"those of before stay in force\"",
                      log_text(error.what()));
    }
    return keys_;
}

FileIdentity ApiKeyFile::identity() const noexcept {
    struct stat status {};
    return ::stat(file_.c_str(), &status) == 0 ? identity_of(status) : FileIdentity{};
}

}  // namespace stipple::server::http
