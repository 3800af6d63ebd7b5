#pragma once

#include "cases.hpp"

#include <iosfwd>
#include <string>
#include <vector>

namespace stipple::bench {

/// One case as a Markdown table, ratios against its first contestant.
void print(std::ostream& out, const CaseResult& result);

/// All runs of all cases, for a program.
void write_json(std::ostream& out, const std::vector<CaseResult>& results);

}  // namespace stipple::bench
