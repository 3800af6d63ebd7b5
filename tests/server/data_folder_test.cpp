#include "store/data_folder.hpp"

#include "store_fixtures.hpp"

#include <chrono>
#include <fstream>
#include <thread>

namespace stipple::server {
namespace {

using namespace stipple::test;
namespace fs = std::filesystem;

void write(const fs::path& file) {
    fs::create_directories(file.parent_path());
    std::ofstream(file) << "work";
}

const std::string kJob = "0123456789abcdef0123456789abcdef";

TEST(DataFolder, IsMadeWhenMissing) {
    const TemporaryFolder folder;
    make_data_folder(folder / "a/b");
    EXPECT_TRUE(fs::is_directory(folder / "a/b"));
    make_data_folder(folder / "a/b");
}

TEST(DataFolder, IsNotSomebodyElsesFolder) {
    for (const char* file : {"scratch/results/thesis.txt", "blobs/tmp-api/image"}) {
        const TemporaryFolder folder;
        write(folder / file);
        expect_error(ErrorCode::InvalidArgument, std::string("it has ") + file,
                     [&] { make_data_folder(folder.path()); });
        EXPECT_TRUE(fs::exists(folder / file));
        std::ofstream(database_in(folder.path())).flush();
        expect_error(ErrorCode::InvalidArgument, "but an empty stipple.sqlite",
                     [&] { make_data_folder(folder.path()); });
        open_sqlite_job_store(database_in(folder.path()));
        EXPECT_NO_THROW(make_data_folder(folder.path()));
    }
}

TEST(DataFolder, IsNotUsedWithoutTheFilesThatItNames) {
    const TemporaryFolder folder;
    const auto jobs = open_sqlite_job_store(database_in(folder.path()));
    EXPECT_NO_THROW(make_data_folder(folder.path()));
    put_cloud(*jobs, "ada", "cloud");
    const auto expect_refused = [&](const char* why) {
        expect_error(ErrorCode::InvalidArgument, why, [&] { make_data_folder(folder.path()); });
    };
    expect_refused("names 1 stored files, but blobs is missing: mount its disk");
    fs::create_directories(blobs_in(folder.path()) / "tmp-api");
    expect_refused("but blobs has none");
    put_blob(*open_file_blob_store(blobs_in(folder.path())), "cloud");
    EXPECT_NO_THROW(make_data_folder(folder.path()));
}

TEST(DataFolder, IsNoStoreByADatabaseThatIsDamaged) {
    const TemporaryFolder folder;
    write(folder / "blobs/ab/file");
    write(database_in(folder.path()));
    EXPECT_THROW(make_data_folder(folder.path()), Error);
}

TEST(DataFolder, MayHaveFilesThatAreNobodysBusiness) {
    const TemporaryFolder folder;
    write(folder / "notes.txt");
    fs::create_directories(folder / "blobs/tmp-api");  // of a first start that was cut off
    EXPECT_NO_THROW(make_data_folder(folder.path()));
}

TEST(DataFolder, IsThatOfOneProcessForEachPart) {
    const TemporaryFolder folder;
    EXPECT_TRUE(lock_parts_to_read(folder.path(), {"api"}).empty());
    EXPECT_TRUE(fs::is_empty(folder.path()));
    const auto api = lock_parts(folder.path(), {"api"});
    EXPECT_NO_THROW(lock_parts(folder.path(), {"worker"}));
    for (const auto lock : {lock_parts, lock_parts_to_read}) {
        expect_error(ErrorCode::Conflict, "as api", [&] {
            lock(folder.path(), {"worker", "api"});
        });
    }
}

TEST(DataFolder, IsWaitedForWhereItsProcessIsAboutToEnd) {
    const TemporaryFolder folder;
    auto api = lock_parts(folder.path(), {"api"});
    const std::jthread ending([&] {
        std::this_thread::sleep_for(std::chrono::milliseconds(100));
        api.clear();
    });
    EXPECT_NO_THROW(lock_parts(folder.path(), {"api"}));
}

TEST(DataFolder, LosesOnlyWhatIsNamedAsTheServerNamesIt) {
    const TemporaryFolder folder;
    const std::vector<std::string> others = {"thesis.txt", kJob + "0", kJob.substr(1) + "A",
                                             "results/" + kJob};
    for (const std::string& file : others) write(folder / file);
    write(folder / kJob / "output/level-0.ply");
    clear_leftovers(folder.path());
    for (const std::string& file : others) EXPECT_TRUE(fs::exists(folder / file)) << file;
    EXPECT_FALSE(fs::exists(folder / kJob));
}

TEST(DataFolder, LosesNothingThatALinkLeadsTo) {
    const TemporaryFolder folder;
    write(folder / "elsewhere" / kJob / "file");
    fs::create_directory_symlink(folder / "elsewhere", folder / "scratch");
    expect_error(ErrorCode::InvalidArgument, "it is a link",
                 [&] { clear_leftovers(folder / "scratch"); });
    fs::create_directory(folder / "own");
    fs::create_directory_symlink(folder / "elsewhere" / kJob, folder / "own" / kJob);
    clear_leftovers(folder / "own");
    EXPECT_TRUE(fs::is_empty(folder / "own"));
    EXPECT_TRUE(fs::exists(folder / "elsewhere" / kJob / "file"));
}

}  // namespace
}  // namespace stipple::server
