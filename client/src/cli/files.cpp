#include "cli/files.hpp"

#include <algorithm>
#include <system_error>

namespace stipple::cli {

namespace fs = std::filesystem;

void require_input(const fs::path& file) {
    std::error_code error;
    const fs::file_status status = fs::status(file, error);
    if (!fs::exists(status)) throw Error(ErrorCode::NotFound, file.string() + ": no such file");
    if (!fs::is_regular_file(status))
        throw Error(ErrorCode::InvalidArgument, file.string() + ": not a regular file");
}

void require_apart(const fs::path& input, const fs::path& output) {
    std::error_code none;
    if (fs::equivalent(input, output, none))
        throw Error(ErrorCode::InvalidArgument,
                    output.string() + ": that is the input: give the output another name");
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
