#include "cli/commands.hpp"
#include "cli/files.hpp"
#include "cli/job_execution.hpp"
#include "cli/progress_bar.hpp"
#include "cli/report.hpp"
#include "cli/text.hpp"
#include "cli/units.hpp"
#include "stipple/cleaning.hpp"
#include "stipple/neighbors.hpp"
#include "stipple/progressive_cloud.hpp"
#include "stipple/proto/digest.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <span>
#include <sstream>
#include <vector>

namespace stipple::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

struct Findings {
    DecodeReport report;
    proto::CloudStatistics statistics;
    std::uint64_t bytes = 0;
    std::string sha256;
    double spacing = 0;  ///< mean distance to the nearest other point, 0 for a single one
    std::vector<ProgressiveBatch> batches;  ///< of a stream
};

/// What a stream says in its header.
std::vector<ProgressiveBatch> batches_of(const fs::path& file) {
    constexpr std::size_t kPiece = 4096;
    std::ifstream stream(file, std::ios::binary);
    ProgressiveDecoder decoder(limits_here(), 1);
    std::vector<char> piece(kPiece);
    while (decoder.batches().empty() && stream) {
        stream.read(piece.data(), kPiece);
        const auto got = static_cast<std::size_t>(stream.gcount());
        decoder.feed(std::as_bytes(std::span(piece).first(got)));
    }
    return decoder.batches();
}

Findings look_at(const fs::path& file, const RunContext& context, ProgressDisplay& display) {
    Findings findings;
    findings.bytes = fs::file_size(file);
    findings.sha256 = proto::sha256_of_file(file);
    PointCloud cloud =
        read_cloud(file, limits_here(), display.stage("decode", 0, 0.4, context), &findings.report);
    const CleaningReport removed = clean(cloud, display.stage("clean", 0.4, 0.6, context));
    findings.statistics =
        proto::describe(cloud, findings.report, removed.non_finite, removed.duplicates);
    if (findings.report.format == CloudFormat::Progressive) findings.batches = batches_of(file);
    findings.spacing = mean_spacing(cloud.positions, display.stage("measure", 0.6, 1, context));
    return findings;
}

ordered_json figures(const fs::path& file, const Findings& findings) {
    ordered_json json = ordered_json::parse(proto::to_json(findings.statistics));
    json["file"] = file.string();
    json["format"] = to_string(findings.report.format);
    json["faces"] = findings.report.faces;
    json["spacing"] = findings.spacing;
    json["bytes"] = findings.bytes;
    json["sha256"] = findings.sha256;
    for (const ProgressiveBatch& batch : findings.batches)
        json["batches"].push_back({{"points", batch.points},
                                   {"bytes", batch.bytes},
                                   {"step", batch.step},
                                   {"mean_error", batch.mean_error}});
    return json;
}

std::string number(double value) {
    std::array<char, 64> text{};
    std::snprintf(text.data(), text.size(), "%.7g", value);
    return text.data();
}

/// `-0.5` of `-0.500`.
std::string without_zeros_at_end(std::string digits) {
    if (digits.find('.') == digits.npos) return digits;
    digits.erase(digits.find_last_not_of('0') + 1);
    if (digits.ends_with('.')) digits.pop_back();
    return digits == "-0" ? "0" : digits;
}

std::string triple(const Vec3d& v, const char* between) {
    return number(v.x()) + between + number(v.y()) + between + number(v.z());
}

/// A corner of the box, as many digits as show a millionth of its longest side, rounded outwards:
/// pasted into another command, the box still has all points.
std::string corner(const Aabb& box, bool upper) {
    constexpr double kDigits = 6;
    const double side = (box.max - box.min).maxCoeff(),
                 shown = side > 0 ? side : std::max(box.max.cwiseAbs().maxCoeff(), 1e-300);
    const int decimals =
        static_cast<int>(std::clamp(kDigits - std::floor(std::log10(shown)), 0.0, 300.0));
    const double unit = std::pow(10.0, -decimals);
    std::string text;
    for (int axis = 0; axis < 3; ++axis) {
        const double v = upper ? box.max[axis] : box.min[axis];
        double rounded = (upper ? std::ceil(v / unit) : std::floor(v / unit)) * unit;
        std::array<char, 700> digits{};
        const auto print = [&] {
            std::snprintf(digits.data(), digits.size(), "%.*f", decimals, rounded);
            return std::strtod(digits.data(), nullptr);
        };
        if (const double told = print(); upper ? told < v : told > v) {
            rounded += upper ? unit : -unit;
            print();
        }
        text += (axis > 0 ? ", " : "") + without_zeros_at_end(digits.data());
    }
    return text;
}

constexpr std::size_t kNameColumns = 12;  // in front of a value

/// None is broken at the end of a line of so many columns.
std::string attribute_list(const std::vector<proto::CloudAttribute>& attributes,
                           std::size_t columns) {
    std::string list;
    std::size_t used = kNameColumns;
    for (const proto::CloudAttribute& attribute : attributes) {
        std::string text = printable(attribute.name + " " + attribute.type);
        if (attribute.components > 1) text += "x" + std::to_string(attribute.components);
        if (&attribute != &attributes.back()) text += ",";
        const bool fits = used + 1 + display_width(text) <= columns;
        if (!list.empty()) list += fits ? " " : "\n" + std::string(kNameColumns, ' ');
        used = (fits && !list.empty() ? used + 1 : kNameColumns) + display_width(text);
        list += text;
    }
    return list;
}

void print_row(std::ostream& out, const TextStyle& style, const std::string& name,
               const std::string& value) {
    if (value.empty()) return;
    const std::string gap(name.size() < kNameColumns ? kNameColumns - name.size() : 1, ' ');
    out << style.dim(name) << gap << value << '\n';
}

void print(std::ostream& out, const Findings& findings, const TextStyle& style,
           std::size_t columns) {
    const proto::CloudStatistics& cloud = findings.statistics;
    const std::string dot = " " + std::string(style.dot()) + " ";
    print_row(out, style, "points", style.strong(with_separators(cloud.points)));
    print_row(out, style, "encoding",
              std::string(to_string(findings.report.format)) + dot + printable(cloud.encoding) +
                  dot + readable_bytes(findings.bytes));
    print_row(out, style, "attributes", attribute_list(cloud.attributes, columns));
    if (!cloud.bounds.empty()) {
        print_row(out, style, "size",
                  triple(cloud.bounds.max - cloud.bounds.min, style.unicode ? " × " : " x "));
        print_row(out, style, "from", corner(cloud.bounds, false));
        print_row(out, style, "to", corner(cloud.bounds, true));
        print_row(out, style, "spacing", number(findings.spacing));
    }
    if (findings.report.faces > 0)
        print_row(out, style, "faces", with_separators(findings.report.faces));
    print_row(out, style, "not used", losses_line(cloud, style));
    for (const ProgressiveBatch& batch : findings.batches) {
        print_row(
            out, style, readable_bytes(batch.bytes),
            with_separators(batch.points) + " points, mean error " + number(batch.mean_error));
    }
    for (const std::string& comment : cloud.comments)
        print_row(out, style, "comment", printable(comment));
    print_row(out, style, "sha-256", findings.sha256);
}

}  // namespace

void run(const InspectCommand& command, const Session& session) {
    require_files({command.input}, {command.common.json});
    const RunContext context = context_of(command.common, session);
    ProgressDisplay display(session.terminal, !command.common.quiet);
    const Findings findings =
        naming(command.input, [&] { return look_at(command.input, context, display); });
    display.finish();
    const bool figures_alone = command.common.json == "-";
    if (!command.common.quiet && !figures_alone) {
        std::ostringstream out;
        print(out, findings, session.terminal.output_style(), session.terminal.output_columns());
        write_out(out.str());
    }
    write_json(command.common.json, figures(command.input, findings));
}

}  // namespace stipple::cli
