#include "scrub.hpp"

#include "store/blob_store.hpp"
#include "store/data_folder.hpp"
#include "store/job_store.hpp"

#include "stipple/error.hpp"

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <iostream>
#include <map>
#include <string>
#include <vector>

namespace stipple::server {

namespace {

/// Of a damaged database the files are compared all the same.
bool has_store(const std::filesystem::path& folder) try {
    return std::filesystem::is_directory(blobs_in(folder)) && is_store(folder);
} catch (const Error& error) {
    if (error.code() == ErrorCode::InvalidArgument) throw;  // another's, or a later version's
    return true;
}

}  // namespace

int scrub(const ServerConfig& config) {
    if (!has_store(config.data))
        throw Error(ErrorCode::NotFound,
                    "--data " + config.data.string() + ": no store there: nothing to compare");
    const auto locks = lock_parts_to_read(config.data, parts_of(Role::All));
    std::vector<std::string> damage = find_damage(database_in(config.data));
    const auto named_blobs = read_referenced_blobs(database_in(config.data), damage);
    for (const std::string& what : damage) std::cout << "database: " << what << '\n';
    const auto blobs = open_file_blob_store(blobs_in(config.data), {});
    std::map<std::string, bool> ids;  // whether the database names it
    for (const std::string& id : blobs->older_than(std::chrono::system_clock::now()))
        ids[id] = false;
    for (const std::string& id : named_blobs) ids[id] = true;
    std::uint64_t whole = 0, bytes = 0, broken = 0, missing = 0;
    for (const auto& [id, named] : ids) {
        try {
            const auto blob = blobs->open(id);  // compares the hash
            if (!blob && named) {
                ++missing;
                std::cout << id << "  is missing, but named in the database\n";
            }
            if (!blob) continue;
            ++whole;
            bytes += blob->size();
        } catch (const Error& error) {
            ++broken;
            std::cout << id << "  " << error.what() << '\n';
        }
    }
    std::cout << whole << " files intact, " << bytes << " bytes; " << broken << " broken, "
              << missing << " missing; database " << (damage.empty() ? "intact" : "damaged")
              << '\n';
    return broken + missing + damage.size() == 0 ? 0 : 1;
}

}  // namespace stipple::server
