#include "scrub.hpp"

#include "store/data_folder.hpp"
#include "store_fixtures.hpp"

#include <fstream>

namespace stipple::server {
namespace {

using namespace stipple::test;

TEST(Scrub, ComparesTheFilesOfADamagedDatabaseAllTheSame) {
    const TemporaryFolder folder;
    ServerConfig config;
    config.data = folder.path();
    {
        const auto jobs = open_sqlite_job_store(database_in(folder.path()));
        put_cloud(*jobs, "ada", "cloud");
        put_blob(*open_file_blob_store(blobs_in(folder.path())), "cloud");
    }
    const auto scrubbed = [&](int status) {
        testing::internal::CaptureStdout();
        EXPECT_EQ(scrub(config), status);
        return testing::internal::GetCapturedStdout();
    };
    EXPECT_NE(scrubbed(0).find("1 files intact, 5 bytes; 0 broken, 0 missing; database intact"),
              std::string::npos);

    std::fstream file(database_in(folder.path()), std::ios::binary | std::ios::in | std::ios::out);
    constexpr std::streamoff kPage = 4096;
    for (const std::streamoff page : {kPage, std::streamoff{0}}) {
        file.seekp(page);  // at first behind the header, which tells what the file is
        for (std::streamoff i = 0; i < kPage; ++i) file.put('\xA5');
        file.flush();
        const std::string said = scrubbed(1);
        EXPECT_NE(said.find("1 files intact"), said.npos) << said;
        EXPECT_NE(said.find("database damaged"), said.npos) << said;
    }
}

}  // namespace
}  // namespace stipple::server
