#include "cli/files.hpp"

#include <algorithm>
#include <cctype>
#include <fstream>
#include <system_error>

namespace stipple::cli {

namespace fs = std::filesystem;

namespace {

/// Also of places where nothing is yet.
bool is_same(const fs::path& a, const fs::path& b) {
    std::error_code none;
    return fs::equivalent(a, b, none) || fs::weakly_canonical(fs::absolute(a), none) ==
                                             fs::weakly_canonical(fs::absolute(b), none);
}

}  // namespace

void require_input(const fs::path& file) {
    if (file == "-")
        throw Error(ErrorCode::NotFound,
                    "-: no such file; standard input is not read: write it to a file first");
    std::error_code error;
    const fs::file_status status = fs::status(file, error);
    if (!fs::exists(status)) throw Error(ErrorCode::NotFound, file.string() + ": no such file");
    if (!fs::is_regular_file(status))
        throw Error(ErrorCode::InvalidArgument,
                    file.string() + ": not a regular file: write what it gives to one first");
}

void require_apart(const std::vector<fs::path>& inputs, const std::vector<fs::path>& outputs) {
    const auto has_place = [](const fs::path& file) { return !file.empty() && file != "-"; };
    for (auto output = outputs.begin(); output != outputs.end(); ++output) {
        if (!has_place(*output)) continue;
        const auto is_here = [&](const fs::path& other) {
            return has_place(other) && is_same(*output, other);
        };
        const bool is_input = std::ranges::any_of(inputs, is_here);
        if (is_input || std::any_of(outputs.begin(), output, is_here))
            throw Error(ErrorCode::InvalidArgument, output->string() + ": that is " +
                                                        (is_input ? "an input" : "another output") +
                                                        ": give the output a name of its own");
    }
}

std::string extension_of(const fs::path& file) {
    std::string extension = file.extension().string();
    std::ranges::transform(extension, extension.begin(),
                           [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return extension;
}

std::vector<std::byte> read_file(const fs::path& file) {
    require_input(file);
    std::vector<std::byte> bytes(fs::file_size(file));
    std::ifstream stream(file, std::ios::binary);
    stream.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    if (!stream) throw Error(ErrorCode::Internal, file.string() + ": cannot be read");
    return bytes;
}

proto::Results read_manifest(const fs::path& folder) {
    const fs::path manifest = folder / "manifest.json";
    const std::vector<std::byte> text = read_file(manifest);
    return naming(manifest, [&] {
        return proto::results_from_json({reinterpret_cast<const char*>(text.data()), text.size()});
    });
}

void move_into_place(const fs::path& from, const fs::path& to) {
    std::error_code error;
    fs::rename(from, to, error);
    if (error)
        throw Error(ErrorCode::InvalidArgument,
                    to.string() + ": cannot be written: " + error.message());
}

proto::OutputFile& first_output(proto::Results& results) {
    const bool one_each = std::ranges::all_of(
        results.levels, [](const proto::OutputCloud& cloud) { return cloud.files.size() == 1; });
    if (results.levels.empty() || !one_each || !results.source)
        throw Error(ErrorCode::Internal, "the job did not make one file of each cloud: " +
                                             std::to_string(results.levels.size()) +
                                             " clouds came");
    return results.levels.front().files.front();
}

Error named_after(const fs::path& file, const Error& error) {
    const bool about_content = error.code() == ErrorCode::MalformedInput ||
                               error.code() == ErrorCode::UnsupportedFormat ||
                               error.code() == ErrorCode::TooLarge;
    const std::string message = error.what();
    if (!about_content || message.starts_with(file.string())) return error;
    return Error(error.code(), file.string() + ": " + message);
}

}  // namespace stipple::cli
