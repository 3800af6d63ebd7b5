#include "codec/ply_layout.hpp"

#include "base/in_quotes.hpp"
#include "cloud/ply_names.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

namespace stipple {

namespace {

constexpr std::array<std::array<std::string_view, 3>, 2> kNormalNames = {
    {kPlyNormals, {"normal_x", "normal_y", "normal_z"}}};
constexpr std::array<std::array<std::string_view, 4>, 4> kColorNames = {
    {kPlyColors,
     {"r", "g", "b", "a"},
     {"diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha"},
     {"diffuse_r", "diffuse_g", "diffuse_b", "diffuse_a"}}};

/// Whether a name is another but for capitals, as in `Red`.
bool equals(std::string_view a, std::string_view b) {
    const auto lower = [](char c) { return 'A' <= c && c <= 'Z' ? static_cast<char>(c + 32) : c; };
    return std::ranges::equal(a, b, {}, lower, lower);
}

std::vector<PlyRole> assign_roles(const PlyElement& vertex) {
    std::vector<PlyRole> roles(vertex.properties.size());
    const auto index_of = [&](std::string_view name) -> std::optional<std::size_t> {
        std::optional<std::size_t> found;
        for (std::size_t i = 0; i < vertex.properties.size(); ++i) {
            const PlyProperty& p = vertex.properties[i];
            if (p.is_list() || !equals(p.name, name)) continue;
            if (p.name == name) return i;  // goes before those in capitals
            if (!found) found = i;
        }
        return found;
    };
    const auto is_capital = [&](std::size_t i) {
        const char first = vertex.properties[i].name.front();
        return 'A' <= first && first <= 'Z';
    };
    const auto assign = [&](std::span<const std::string_view> names, PlyRole::Kind kind) {
        for (unsigned component = 0; component < names.size(); ++component) {
            const auto index = index_of(names[component]);
            if (!index) continue;
            // Beside `r` an `A` is something else, as an amplitude.
            const bool is_other = kind == PlyRole::Color && component == 3 &&
                                  is_capital(*index) != is_capital(*index_of(names[0]));
            if (!is_other) roles[*index] = {kind, component};
        }
    };
    // Of several families of names the first that is whole counts; the others are attributes like
    // any.
    const auto assign_first_whole = [&](const auto& families, PlyRole::Kind kind) {
        for (const auto& names : families) {
            if (std::all_of(names.begin(), names.begin() + 3,
                            [&](auto n) { return index_of(n).has_value(); })) {
                return assign(names, kind);
            }
        }
    };

    for (const std::string_view name : kPlyAxes) {
        if (!index_of(name)) {
            throw Error(ErrorCode::MalformedInput,
                        "PLY header: element 'vertex' has no property '" + std::string(name) +
                            "': a point needs x, y and z");
        }
    }
    assign(kPlyAxes, PlyRole::Position);
    assign_first_whole(kNormalNames, PlyRole::Normal);
    assign_first_whole(kColorNames, PlyRole::Color);
    return roles;
}

}  // namespace

bool PlyLayout::has(PlyRole::Kind kind, unsigned component) const {
    return std::ranges::any_of(
        roles, [&](const PlyRole& r) { return r.kind == kind && r.component == component; });
}

bool PlyLayout::wide_coordinates() const {
    for (std::size_t i = 0; i < roles.size(); ++i) {
        const PlyType type = vertex->properties[i].type;
        const bool fits_float = type == PlyType::Float32 || size_of(type) <= 2;
        if (!fits_float && roles[i].kind == PlyRole::Position) return true;
    }
    return false;
}

PlyLayout ply_layout_of(std::span<const std::byte> file) {
    PlyLayout layout{file, parse_ply_header(file), nullptr, {}};
    const auto& elements = layout.header.elements;
    const auto vertex = std::ranges::find(elements, "vertex", &PlyElement::name);
    if (vertex == elements.end()) {
        std::string names;
        for (const PlyElement& element : elements)
            names += (names.empty() ? "" : ", ") + in_quotes(element.name);
        throw Error(ErrorCode::MalformedInput,
                    "PLY header: no element 'vertex', which holds the points" +
                        (names.empty() ? "" : "; it has " + names));
    }
    layout.vertex = &*vertex;
    layout.roles = assign_roles(*vertex);
    return layout;
}

void check_against(const DecodeLimits& limits, const PlyLayout& layout) {
    const std::uint64_t most =
        std::min<std::uint64_t>(limits.max_points, std::numeric_limits<Index>::max());
    if (layout.vertex->count > most) {
        throw Error(ErrorCode::TooLarge, "PLY header: " + std::to_string(layout.vertex->count) +
                                             " vertices: expected at most " + std::to_string(most) +
                                             "; split the cloud, or raise the limit");
    }
    const auto attributes = std::ranges::count(layout.roles, PlyRole::Attribute, &PlyRole::kind);
    if (std::cmp_greater(attributes, limits.max_attributes)) {
        throw Error(
            ErrorCode::TooLarge,
            "PLY header: " + std::to_string(attributes) +
                " properties of a vertex besides position, normal and colour: expected at most " +
                std::to_string(limits.max_attributes) + "; remove some, or raise the limit");
    }
    const auto is_control = [](char c) { return (c >= 0 && c < ' ') || c == '\x7f'; };
    for (const PlyProperty& property : layout.vertex->properties) {
        if (std::ranges::any_of(property.name, is_control)) {
            throw Error(ErrorCode::MalformedInput,
                        "PLY header: property " + in_quotes(property.name) +
                            " of element 'vertex': expected a name without control characters");
        }
    }
}

void describe(const PlyLayout& layout, DecodeReport& report) {
    report.encoding = name_of(layout.header.encoding);
    report.points = layout.vertex->count;
    report.comments = layout.header.comments;
    report.skipped = layout.header.unknown_lines;
    for (const PlyElement& element : layout.header.elements) {
        if (&element == layout.vertex || element.count == 0) continue;
        if (element.name == "face") report.faces = element.count;
        if (!element.has_list()) report.skipped.push_back(element.name);
        for (const PlyProperty& property : element.properties) {
            if (property.is_list()) report.skipped.push_back(element.name + "." + property.name);
        }
    }
}

}  // namespace stipple
