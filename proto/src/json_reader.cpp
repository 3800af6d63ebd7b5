#include "json_reader.hpp"

#include <cmath>

namespace stipple::proto {

namespace {

using nlohmann::json;

constexpr std::size_t kShownCharacters = 60;

/// A value as a message shows it: short, and on one line.
std::string shown(const json& value) {
    if (value.is_object()) return "an object";
    if (value.is_array()) return "a list of " + std::to_string(value.size());
    const bool long_text =
        value.is_string() && value.get_ref<const std::string&>().size() > kShownCharacters;
    const json part =
        long_text ? json(value.get_ref<const std::string&>().substr(0, kShownCharacters) + "...")
                  : value;
    return part.dump(-1, ' ', false, json::error_handler_t::replace);
}

std::string join(const std::string& path, std::string_view name) {
    return path.empty() ? std::string(name) : path + "." + std::string(name);
}

/// Sees every key as it is read: the finished object no longer knows that one came twice.
class Watcher {
public:
    explicit Watcher(const JsonRules& rules) : rules_(rules) {}

    bool operator()(int depth, json::parse_event_t event, const json& parsed) {
        using Event = json::parse_event_t;
        if (event == Event::object_start || event == Event::array_start) {
            if (depth >= rules_.max_depth) {
                throw Error(rules_.code,
                            "JSON: nested more than " + std::to_string(rules_.max_depth) + " deep");
            }
        }
        if (event == Event::object_start) keys_.emplace_back();
        if (event == Event::object_end) keys_.pop_back();
        const bool is_text = event == Event::key || (event == Event::value && parsed.is_string());
        if (!rules_.allows_nul && is_text &&
            parsed.get_ref<const std::string&>().find('\0') != std::string::npos)
            throw Error(rules_.code, "JSON: " + shown(parsed) + ": expected text without NUL");
        if (event == Event::key && !keys_.back().insert(parsed.get<std::string>()).second) {
            throw Error(rules_.code, "JSON: the field " + shown(parsed) + " is given twice");
        }
        return true;
    }

private:
    const JsonRules& rules_;
    std::vector<std::set<std::string>> keys_;
};

json parse(std::string_view text, const JsonRules& rules) {
    if (text.size() > rules.max_bytes) {
        throw Error(rules.code, "JSON: " + std::to_string(text.size()) +
                                    " bytes: expected at most " + std::to_string(rules.max_bytes));
    }
    try {
        Watcher watcher(rules);
        return json::parse(text, std::ref(watcher));
    } catch (const json::parse_error& error) {
        throw Error(rules.code, "JSON: not well-formed at byte " + std::to_string(error.byte));
    } catch (const json::exception&) {
        throw Error(rules.code, "JSON: a number is out of range");
    }
}

/// Limits that are those of the machine are not told: what is read has limits of its own.
std::string expected_integer(std::uint64_t min, std::uint64_t max, bool is_whole) {
    const bool has_limit = max != std::numeric_limits<std::uint64_t>::max() &&
                           max != std::numeric_limits<std::uint32_t>::max();
    if (has_limit) return "an integer of " + std::to_string(min) + " to " + std::to_string(max);
    if (is_whole) return "at most " + std::to_string(max);
    return min > 0 ? "an integer of at least " + std::to_string(min) : "a whole number";
}

/// The whole number that a JSON number is, in whichever form it was written.
std::optional<std::uint64_t> whole(const json& value) {
    constexpr double kTwoTo53 = 9007199254740992.0;  // up to here every whole double is exact
    if (value.is_number_unsigned()) return value.get<std::uint64_t>();
    if (!value.is_number_float()) return std::nullopt;
    const double number = value.get<double>();
    if (number < 0 || number > kTwoTo53 || number != std::floor(number)) return std::nullopt;
    return static_cast<std::uint64_t>(number);
}

}  // namespace

std::string to_text(const Json& json) {
    return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::string JsonValue::text() const {
    if (!value_->is_string()) refuse("a string");
    return value_->get<std::string>();
}

bool JsonValue::boolean() const {
    if (!value_->is_boolean()) refuse("true or false");
    return value_->get<bool>();
}

double JsonValue::number() const {
    if (!value_->is_number()) refuse("a number");
    return value_->get<double>();
}

std::uint64_t JsonValue::integer(std::uint64_t min, std::uint64_t max) const {
    const std::optional<std::uint64_t> number = whole(*value_);
    if (!number || *number < min || *number > max)
        refuse(expected_integer(min, max, number && *number > max));
    return *number;
}

std::vector<JsonValue> JsonValue::items() const {
    if (!value_->is_array()) refuse("a list");
    require_few();
    std::vector<JsonValue> result;
    result.reserve(value_->size());
    for (std::size_t i = 0; i < value_->size(); ++i) {
        result.emplace_back((*value_)[i], path_ + "[" + std::to_string(i) + "]", *rules_);
    }
    return result;
}

std::vector<std::pair<std::string, JsonValue>> JsonValue::members() const {
    if (!value_->is_object()) refuse("an object");
    require_few();
    std::vector<std::pair<std::string, JsonValue>> result;
    for (const auto& [name, value] : value_->items()) {
        result.emplace_back(name, JsonValue(value, join(path_, name), *rules_));
    }
    return result;
}

void JsonValue::require_few() const {
    if (value_->size() <= rules_->max_items) return;
    throw Error(rules_->code, located(std::to_string(value_->size()) + " items: expected at most " +
                                      std::to_string(rules_->max_items)));
}

JsonObject JsonValue::object() const {
    if (!value_->is_object()) refuse("an object");
    return JsonObject(*this);
}

void JsonValue::refuse(std::string_view expected) const {
    const std::string where = path_.empty() ? "JSON" : path_;
    throw Error(rules_->code,
                where + ": " + shown(*value_) + ": expected " + std::string(expected));
}

std::string JsonValue::located(const std::string& message) const {
    return message.starts_with(path_ + " ") ? message : path_ + ": " + message;
}

JsonValue JsonObject::operator[](const char* name) {
    std::optional<JsonValue> field = find(name);
    if (!field) throw error(name, "missing: this field is required");
    return *std::move(field);
}

std::optional<JsonValue> JsonObject::find(const char* name) {
    known_.insert(name);
    const auto found = value_.value_->find(name);
    if (found == value_.value_->end()) return std::nullopt;
    return JsonValue(*found, join(value_.path_, name), *value_.rules_);
}

void JsonObject::finish() const {
    if (value_.rules_->unknown_fields == UnknownFields::Ignored) return;
    for (const auto& [name, value] : value_.value_->items()) {
        if (known_.contains(name)) continue;
        std::string names;
        for (const std::string& known : known_) names += (names.empty() ? "" : ", ") + known;
        throw error(name.substr(0, kShownCharacters), "unknown field: expected one of " + names);
    }
}

Error JsonObject::error(std::string_view name, std::string_view what) const {
    const std::string where = name.empty() ? value_.path_ : join(value_.path_, name);
    return Error(value_.rules_->code, (where.empty() ? "JSON" : where) + ": " + std::string(what));
}

JsonDocument::JsonDocument(std::string_view text, const JsonRules& rules)
    : rules_(rules), json_(parse(text, rules)) {}

}  // namespace stipple::proto
