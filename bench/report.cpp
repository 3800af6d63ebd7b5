#include "report.hpp"

#include <algorithm>
#include <iomanip>
#include <nlohmann/json.hpp>
#include <ostream>
#include <sstream>
#include <utility>

namespace stipple::bench {

namespace {

using nlohmann::ordered_json;

std::string fixed(double value, int decimals) {
    std::ostringstream out;
    out << std::fixed << std::setprecision(decimals) << value;
    return out.str();
}

/// Three significant digits are enough for a time.
std::string milliseconds(double seconds) {
    const double ms = 1e3 * seconds;
    return fixed(ms, ms < 10 ? 2 : ms < 100 ? 1 : 0);
}

using Row = std::vector<std::string>;

constexpr int kMemoryColumn = 6;

bool states_memory(const CaseResult& result) {
    return std::ranges::any_of(result.standings,
                               [](const Standing& s) { return s.stated_bytes > 0; });
}

Row heading(const CaseResult& result) {
    Row row = {"contestant", "wall ms",  "best", "worst",      "CPU ms",
               "M/s",        "M/s core", "+MB",  "wall ratio", "CPU ratio"};
    const auto widest = std::ranges::max_element(
        result.standings, {}, [](const Standing& standing) { return standing.figures.size(); });
    if (states_memory(result)) row.insert(row.begin() + kMemoryColumn + 1, "stated MB");
    for (const Figure& figure : widest->figures) row.push_back(figure.name);
    return row;
}

Row row_of(const CaseResult& result, const Standing& standing) {
    const Standing& first = result.standings.front();
    const std::size_t runs = standing.runs.size(), rounds = first.runs.size();
    const std::string fewer =
        runs < rounds ? " (" + std::to_string(runs) + (runs == 1 ? " run)" : " runs)") : "";
    Row row = {standing.name + fewer,
               milliseconds(standing.median_wall()),
               milliseconds(standing.best_wall()),
               milliseconds(standing.worst_wall()),
               milliseconds(standing.median_cpu()),
               fixed(1e-6 * static_cast<double>(result.units) / standing.median_wall(), 2),
               fixed(1e-6 * static_cast<double>(result.units) / standing.median_cpu(), 2),
               fixed(1e-6 * static_cast<double>(standing.peak_bytes()), 0),
               fixed(median_ratio(first, standing, &Timing::wall_s), 2),
               fixed(median_ratio(first, standing, &Timing::cpu_s), 2)};
    if (states_memory(result)) {
        const std::string stated = fixed(1e-6 * static_cast<double>(standing.stated_bytes), 0);
        row.insert(row.begin() + kMemoryColumn + 1, standing.stated_bytes == 0 ? ""
                                                    : standing.is_above_stated()
                                                        ? stated + " **exceeded**"
                                                        : stated);
    }
    for (const Figure& figure : standing.figures)
        row.push_back(fixed(figure.value, figure.decimals));
    return row;
}

void print_row(std::ostream& out, const Row& row, std::size_t columns) {
    out << '|';
    for (std::size_t i = 0; i < columns; ++i) out << ' ' << (i < row.size() ? row[i] : "") << " |";
    out << '\n';
}

ordered_json json_of(const Standing& standing) {
    ordered_json runs = ordered_json::array(), figures = ordered_json::object();
    for (const Timing& run : standing.runs)
        runs.push_back(
            {{"wall_s", run.wall_s}, {"cpu_s", run.cpu_s}, {"peak_bytes", run.peak_bytes}});
    for (const Figure& figure : standing.figures) figures[figure.name] = figure.value;
    return {{"contestant", standing.name},
            {"runs", std::move(runs)},
            {"stated_bytes", standing.stated_bytes},
            {"figures", std::move(figures)}};
}

}  // namespace

void print(std::ostream& out, const CaseResult& result) {
    out << "\n### " << result.name << ", " << result.threads
        << (result.threads == 1 ? " thread" : " threads") << "\n"
        << result.work << "\n\n";
    const Row head = heading(result);
    print_row(out, head, head.size());
    print_row(out, Row(head.size(), "---"), head.size());
    for (const Standing& standing : result.standings)
        print_row(out, row_of(result, standing), head.size());
    out.flush();
}

void write_json(std::ostream& out, const std::vector<CaseResult>& results) {
    ordered_json json = ordered_json::array();
    for (const CaseResult& result : results) {
        ordered_json standings = ordered_json::array();
        for (const Standing& standing : result.standings) standings.push_back(json_of(standing));
        json.push_back({{"case", result.name},
                        {"threads", result.threads},
                        {"work", result.work},
                        {"units", result.units},
                        {"standings", std::move(standings)}});
    }
    out << json.dump(1) << '\n';
}

}  // namespace stipple::bench
