#pragma once

#include "cli/command_line.hpp"

#include <map>
#include <string>

namespace stipple::cli {

/// What the words on a command line stand for.
template <typename T>
using Names = std::map<std::string, T>;

/// @throws UsageError naming the option and the words there are.
template <typename T>
T named(const Names<T>& names, const std::string& name, const std::string& option) {
    const auto found = names.find(name);
    if (found != names.end()) return found->second;
    std::string list;
    for (const auto& [known, value] : names) list += (list.empty() ? "" : ", ") + known;
    throw UsageError(option + " " + name + ": expected one of " + list);
}

}  // namespace stipple::cli
