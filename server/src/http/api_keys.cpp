#include "http/api_keys.hpp"

#include "stipple/error.hpp"
#include "stipple/proto/digest.hpp"

#include <fstream>
#include <nlohmann/json.hpp>
#include <span>

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

void grant_scope(ApiKeys::Grant& grant, const std::string& scope) {
    if (scope != "read" && scope != "submit" && scope != "admin") {
        throw Error(ErrorCode::InvalidArgument,
                    "scope \"" + scope + "\": expected read, submit or admin");
    }
    if (scope != "submit") grant.read = true;
    if (scope != "read") grant.submit = true;
}

ApiKeys::Grant read_grant(const Json& entry) {
    ApiKeys::Grant grant{.tenant = entry.at("tenant")};
    if (grant.tenant.empty()) throw Error(ErrorCode::InvalidArgument, "tenant is empty");
    for (const Json& scope : entry.at("scopes")) grant_scope(grant, scope.get<std::string>());
    return grant;
}

}  // namespace

bool ApiKeys::Grant::allows(Scope scope) const noexcept {
    return scope == Scope::Open || (scope == Scope::Read && read) ||
           (scope == Scope::Submit && submit);
}

ApiKeys ApiKeys::read(const std::filesystem::path& file) {
    const auto refuse = [&file](const std::string& why) {
        return Error(ErrorCode::InvalidArgument, "API keys " + file.string() + ": " + why);
    };
    std::ifstream in(file);
    if (!in) throw refuse("the file cannot be read");
    ApiKeys keys;
    try {
        for (const Json& entry : Json::parse(in)) {
            const std::string hash = entry.at("key_sha256");
            if (!proto::is_sha256(hash)) {
                throw refuse(
                    "key_sha256 is not 64 lower-case hexadecimal digits: make it with `printf %s "
                    "KEY | sha256sum`");
            }
            keys.entries_.push_back({hash, read_grant(entry)});
        }
    } catch (const Json::exception& error) {
        throw refuse(error.what());
    }
    if (keys.entries_.empty()) throw refuse("there is no key in it");
    return keys;
}

std::optional<ApiKeys::Grant> ApiKeys::find(std::string_view key) const {
    const std::string hash = proto::sha256_hex(std::as_bytes(std::span(key)));
    const Entry* found = nullptr;
    for (const Entry& entry : entries_)
        if (equal_in_constant_time(entry.key_sha256, hash)) found = &entry;
    return found != nullptr ? std::optional(found->grant) : std::nullopt;
}

}  // namespace stipple::server::http
