#pragma once

#include "stipple/error.hpp"

#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace stipple::proto {

/// How documents are written: keys in the order in which they were set.
using Json = nlohmann::ordered_json;

/// One line. Bytes that are not UTF-8 (a PLY comment can hold any) become U+FFFD.
std::string to_text(const Json& json);

/// What a program that does not know a field makes of it: a mistake of who asks for something, news
/// of a later version that tells something.
enum class UnknownFields { Refused, Ignored };

/// What a text may be. All refusals carry `code`.
struct JsonRules {
    ErrorCode code = ErrorCode::MalformedInput;
    std::size_t max_bytes = 64 << 20;
    int max_depth = 16;
    std::size_t max_items =
        std::numeric_limits<std::size_t>::max();  ///< of a list, or named freely
    UnknownFields unknown_fields = UnknownFields::Ignored;
    bool allows_nul = true;  ///< in texts and names: that of an error would end there
};

class JsonObject;

/// A value that knows where in its document it stands, so that a refusal names the field, the value
/// and what is expected: `points: -3: expected an integer of at least 1`.
class JsonValue {
public:
    JsonValue(const nlohmann::json& value, std::string path, const JsonRules& rules)
        : value_(&value), path_(std::move(path)), rules_(&rules) {}

    bool is_text() const { return value_->is_string(); }
    bool is(const Json& other) const { return *value_ == nlohmann::json(other); }
    std::string text() const;
    bool boolean() const;
    double number() const;
    /// Also in the form 5e3 or 5000.0: JSON knows one kind of number.
    std::uint64_t integer(std::uint64_t min = 0,
                          std::uint64_t max = std::numeric_limits<std::uint64_t>::max()) const;
    unsigned small_integer(unsigned min = 0,
                           unsigned max = std::numeric_limits<unsigned>::max()) const {
        return static_cast<unsigned>(integer(min, max));
    }
    std::vector<JsonValue> items() const;
    std::vector<std::pair<std::string, JsonValue>> members() const;
    JsonObject object() const;

    /// What `from_name` (one that throws an `Error` for other names) makes of a text.
    template <typename FromName>
    auto named(FromName&& from_name) const {
        const std::string name = text();
        try {
            return from_name(std::string_view(name));
        } catch (const Error& error) {
            throw Error(rules_->code, located(error.what()));
        }
    }

    /// What `read` makes of each item.
    template <typename Read>
    auto list_of(Read&& read) const {
        std::vector<decltype(read(std::declval<const JsonValue&>()))> list;
        for (const JsonValue& item : items()) list.push_back(read(item));
        return list;
    }

    [[noreturn]] void refuse(std::string_view expected) const;

private:
    friend class JsonObject;

    void require_few() const;
    /// `message` with the place before it, unless it begins with the field's name itself.
    std::string located(const std::string& message) const;

    const nlohmann::json* value_;
    std::string path_;
    const JsonRules* rules_;
};

/// An object whose fields are taken one by one.
class JsonObject {
public:
    explicit JsonObject(const JsonValue& value) : value_(value) {}

    /// A field that must be there.
    JsonValue operator[](const char* name);
    /// A field that may be absent.
    std::optional<JsonValue> find(const char* name);
    bool has(std::string_view name) const { return value_.value_->contains(name); }
    /// Refuses fields that were never asked for, where the rules say so. Call when all were.
    void finish() const;
    /// An error about the field `name`, or about the object as a whole when it is empty.
    Error error(std::string_view name, std::string_view what) const;

private:
    JsonValue value_;
    std::set<std::string, std::less<>> known_;
};

/// A document that was read with duplicate keys, depth and size checked. Keep it while its values
/// are in use.
class JsonDocument {
public:
    JsonDocument(std::string_view text, const JsonRules& rules);
    JsonValue root() const { return {json_, "", rules_}; }
    JsonObject object() const { return root().object(); }

private:
    JsonRules rules_;
    nlohmann::json json_;
};

}  // namespace stipple::proto
