#include "http/job_fields.hpp"

#include "http/query.hpp"

#include <cstdint>
#include <string>

namespace stipple::server::http {

using Json = nlohmann::json;

void add_names(std::vector<std::string_view>& names, std::span<const JobField> fields) {
    for (const JobField& field : fields) names.emplace_back(field.name);
}

void copy_fields(const Request& request, std::span<const JobField> fields, Json& out) {
    using enum JobField::Kind;
    for (const auto& [name, kind] : fields) {
        const auto text = request.query_value(name);
        if (!text) continue;
        if (kind == Text) out[name] = *text;
        if (kind == Count) out[name] = *query_count(request, name, 0, UINT64_MAX);
        if (kind == Number) out[name] = *query_number(request, name);
        if (kind == Distance && text->ends_with('%')) out[name] = *text;
        if (kind == Distance && !text->ends_with('%')) out[name] = *query_number(request, name);
        if (kind == Truth) out[name] = *query_truth(request, name);
    }
}

DracoEncodeOptions query_draco(const Request& request, CloudFormat format) {
    Json draco = Json::object();
    copy_fields(request, kDracoFields, draco);
    if (!draco.empty() && format != CloudFormat::Draco)
        throw HttpError(400, draco.begin().key() + ": belongs to format drc");
    return proto::draco_options_from_json(
        draco.dump(-1, ' ', false, Json::error_handler_t::replace));
}

}  // namespace stipple::server::http
