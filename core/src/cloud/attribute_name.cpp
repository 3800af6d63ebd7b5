#include "cloud/attribute_name.hpp"

#include "cloud/ply_names.hpp"
#include "cloud/whole_numbers.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <set>
#include <type_traits>
#include <variant>

namespace stipple {

namespace {

constexpr std::size_t kLongest = 255;

}  // namespace

std::string attribute_name_of(std::string_view foreign) {
    std::string name;
    bool any = false;
    for (const char c : foreign) {
        const bool is_allowed = is_attribute_name({&c, 1});
        any = any || is_allowed;
        // One for all bytes of a letter, or several such.
        if (is_allowed || name.empty() || name.back() != '_') name += is_allowed ? c : '_';
    }
    return any ? name.substr(0, kLongest) : std::string();
}

bool is_known_as(std::string_view name, std::string_view known) {
    const auto plain = [](std::string_view text) {
        std::string letters;
        for (const unsigned char c : text)
            if (c != '_' && c != ' ') letters += static_cast<char>(std::tolower(c));
        return letters;
    };
    const std::string its = plain(name), wanted = plain(known);
    return its == wanted || its == "scalar" + wanted;
}

Reduction reduction_of(std::string_view name, const AttributeValues& values) {
    const auto may_be_labels = []<typename T>(const std::vector<T>& numbers) {
        if constexpr (std::is_integral_v<T>)
            return true;
        else  // unknown ones may be among them
            return std::ranges::all_of(numbers, [](T v) { return std::isnan(v) || is_whole(v); });
    };
    return is_known_as(name, "gps_time") || std::visit(may_be_labels, values)
               ? Reduction::Nearest
               : default_reduction(values);
}

std::vector<std::string> settle_names(PointCloud& cloud) {
    std::vector<std::string> changes;
    std::set<std::string, std::less<>> taken(kPlyAxes.begin(), kPlyAxes.end());
    if (!cloud.normals.empty()) taken.insert(kPlyNormals.begin(), kPlyNormals.end());
    if (!cloud.colors.empty())
        taken.insert(kPlyColors.begin(), kPlyColors.end() - (cloud.has_alpha ? 0 : 1));
    for (Attribute& attribute : cloud.attributes) {
        std::string name = attribute_name_of(attribute.name);
        if (name.empty()) name = "attribute";
        const std::string stem = name;
        for (unsigned i = 2; !taken.insert(name).second; ++i) {
            const std::string number = "_" + std::to_string(i);
            name = stem.substr(0, kLongest - number.size()) + number;
        }
        if (name != attribute.name) changes.push_back("name " + attribute.name + " → " + name);
        attribute.name = std::move(name);
    }
    return changes;
}

}  // namespace stipple
