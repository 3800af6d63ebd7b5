#include "store/blob_store.hpp"

#include "store_fixtures.hpp"

#include "store/posix_file.hpp"

#include <fcntl.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <algorithm>
#include <atomic>
#include <fstream>
#include <mutex>
#include <thread>

namespace {

/// What the store asks of the system, in order, while a test looks.
class SystemCallLog {
public:
    void start() {
        const std::lock_guard lock(mutex_);
        on_ = true;
        calls_.clear();
    }
    std::vector<std::string> stop() {
        const std::lock_guard lock(mutex_);
        on_ = false;
        return calls_;
    }
    void add(const std::string& call) {
        const std::lock_guard lock(mutex_);
        if (on_) calls_.push_back(call);
    }

private:
    std::mutex mutex_;
    bool on_ = false;
    std::vector<std::string> calls_;
};

SystemCallLog& system_calls() {
    static SystemCallLog log;
    return log;
}

}  // namespace

// Stand before those of the C library in this program.
extern "C" int fsync(int fd) {
    struct stat status {};
    ::fstat(fd, &status);
    system_calls().add(S_ISDIR(status.st_mode) ? "sync folder" : "sync file");
    return static_cast<int>(::syscall(SYS_fsync, fd));
}

extern "C" int syncfs(int fd) noexcept {
    system_calls().add("sync all");
    return static_cast<int>(::syscall(SYS_syncfs, fd));
}

extern "C" int rename(const char* from, const char* to) noexcept {
    system_calls().add("rename");
    return static_cast<int>(::syscall(SYS_rename, from, to));
}

namespace stipple::server {
namespace {

namespace fs = std::filesystem;
using namespace stipple::test;
using std::chrono::system_clock;

constexpr const char* kHashOfAbc =
    "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";

class FileBlobStore : public testing::Test {
protected:
    fs::path file_of(const std::string& id) const {
        return folder_.path() / id.substr(0, 2) / id.substr(2, 2) / id;
    }
    std::size_t temporary_files() const {
        const fs::directory_iterator entries(folder_ / "tmp");
        return static_cast<std::size_t>(std::distance(begin(entries), end(entries)));
    }
    /// Behind the store's back.
    void overwrite(const std::string& id, const std::string& text) const {
        fs::permissions(file_of(id), fs::perms::owner_all);
        std::ofstream(file_of(id), std::ios::trunc) << text;
    }

    TemporaryFolder folder_;
    std::unique_ptr<BlobStore> store_ = open_file_blob_store(folder_.path());
};

TEST_F(FileBlobStore, NamesABlobByTheHashOfItsBytes) {
    const auto writer = store_->create(10);
    writer->write(bytes_of("a"));
    writer->write(bytes_of("bc"));
    EXPECT_EQ(writer->size(), 3U);
    EXPECT_EQ(writer->commit(), kHashOfAbc);
    EXPECT_TRUE(fs::exists(file_of(kHashOfAbc)));

    const auto blob = store_->open(kHashOfAbc);
    ASSERT_TRUE(blob);
    EXPECT_EQ(blob->size(), 3U);
    EXPECT_EQ(text_of(*blob), "abc");
    EXPECT_EQ(blob->path(), file_of(kHashOfAbc));
}

TEST_F(FileBlobStore, SyncsTheBytesBeforeTheNameAndTheNameBeforeItReturns) {
    const auto writer = store_->create(10);
    writer->write(bytes_of("abc"));
    system_calls().start();
    writer->commit();
    const std::vector<std::string> calls = system_calls().stop();
    EXPECT_EQ(calls, (std::vector<std::string>{"sync file", "rename", "sync folder", "sync folder",
                                               "sync folder"}));
}

TEST_F(FileBlobStore, ReadsAnyPartOfABlob) {
    const auto blob = store_->open(put_blob(*store_, "0123456789"));
    std::string part(4, ' ');
    EXPECT_EQ(blob->read(3, std::as_writable_bytes(std::span(part))), 4U);
    EXPECT_EQ(part, "3456");
    EXPECT_EQ(blob->read(8, std::as_writable_bytes(std::span(part))), 2U);
    EXPECT_EQ(blob->read(10, std::as_writable_bytes(std::span(part))), 0U);
}

TEST_F(FileBlobStore, KeepsNothingOfABlobThatIsNotCommitted) {
    {
        const auto writer = store_->create(10);
        writer->write(bytes_of("abc"));
        EXPECT_EQ(temporary_files(), 1U);
    }
    EXPECT_EQ(temporary_files(), 0U);
    EXPECT_FALSE(store_->open(kHashOfAbc));
}

TEST_F(FileBlobStore, HoldsBytesWithoutANameForAsLongAsTheyAreRead) {
    const auto held = store_->hold(bytes_of("0123456789"));
    EXPECT_EQ(temporary_files(), 0U);
    ASSERT_EQ(held->size(), 10U);
    std::string part(4, ' ');
    EXPECT_EQ(held->read(3, std::as_writable_bytes(std::span(part))), 4U);
    EXPECT_EQ(part, "3456");
}

TEST_F(FileBlobStore, RemovesAtItsStartWhatAKilledProcessLeftUnfinished) {
    std::ofstream(folder_ / "tmp/0123456789abcdef0123456789abcdef") << "half a cloud";
    store_ = open_file_blob_store(folder_.path());
    EXPECT_EQ(temporary_files(), 0U);
}

TEST_F(FileBlobStore, ChangesNothingForWhoOnlyReads) {
    const std::string id = put_blob(*store_, "abc");
    fs::remove_all(folder_ / "tmp");
    const auto reader = open_file_blob_store(folder_.path(), {});
    EXPECT_EQ(text_of(*reader->open(id)), "abc");
    EXPECT_FALSE(fs::exists(folder_ / "tmp"));
    EXPECT_THROW(reader->create(1), Error);
}

TEST_F(FileBlobStore, RefusesTheFirstByteAboveTheLimit) {
    const auto writer = store_->create(3);
    writer->write(bytes_of("abc"));
    expect_error(ErrorCode::TooLarge, "more than 3 bytes", [&] { writer->write(bytes_of("d")); });
    EXPECT_EQ(writer->size(), 3U);
}

TEST_F(FileBlobStore, KeepsTheSameBytesOnce) {
    EXPECT_EQ(put_blob(*store_, "abc"), put_blob(*store_, "abc"));
    EXPECT_EQ(temporary_files(), 0U);
    EXPECT_EQ(store_->older_than(system_clock::now() + std::chrono::hours(1)),
              std::vector<std::string>{kHashOfAbc});
}

TEST_F(FileBlobStore, TakesTheSameBytesFromManyThreadsAtATime) {
    std::vector<std::jthread> threads;
    for (int i = 0; i < 8; ++i) {
        threads.emplace_back([this, i] {
            for (int round = 0; round < 10; ++round) {
                put_blob(*store_, "abc");
                put_blob(*store_, std::to_string(i * 100 + round));
            }
        });
    }
    threads.clear();
    EXPECT_EQ(text_of(*store_->open(kHashOfAbc)), "abc");
    EXPECT_EQ(store_->older_than(system_clock::now() + std::chrono::hours(1)).size(), 81U);
}

TEST_F(FileBlobStore, FindsOutThatBytesWereChangedBehindItsBack) {
    const std::string id = put_blob(*store_, "abc");
    overwrite(id, "abd");
    expect_error(ErrorCode::Internal, "damaged", [&] { store_->open(id); });
    store_ = open_file_blob_store(folder_.path());
    expect_error(ErrorCode::Internal, "damaged", [&] { store_->open(id); });
}

TEST_F(FileBlobStore, MendsADamagedBlobWhenItsBytesComeAgain) {
    const std::string id = put_blob(*store_, "abc");
    overwrite(id, "ab");
    put_blob(*store_, "abc");
    EXPECT_EQ(text_of(*store_->open(id)), "abc");
}

TEST_F(FileBlobStore, HasNothingUnderANameThatIsNoHash) {
    std::ofstream(folder_ / "secret") << "secret";
    for (const char* name : {"", "secret", "../secret", "../../../../etc/passwd",
                             "BA7816BF8F01CFEA414140DE5DAE2223B00361A396177A9CB410FF61F20015AD"}) {
        EXPECT_FALSE(store_->open(name)) << name;
        EXPECT_FALSE(store_->remove_older(name, system_clock::now())) << name;
    }
    EXPECT_TRUE(fs::exists(folder_ / "secret"));
}

TEST_F(FileBlobStore, MovesAFinishedFileInUnderTheHashOfItsBytes) {
    const fs::path file = folder_ / "level-0.ply";
    std::ofstream(file) << "abc";
    EXPECT_EQ(store_->adopt(file), kHashOfAbc);
    EXPECT_FALSE(fs::exists(file));
    EXPECT_EQ(text_of(*store_->open(kHashOfAbc)), "abc");
}

TEST_F(FileBlobStore, SyncsTheBytesOfManyFilesTogetherBeforeTheirNames) {
    std::vector<fs::path> files;
    for (int i = 0; i < 20; ++i) {
        files.push_back(folder_ / ("tile-" + std::to_string(i)));
        std::ofstream(files.back()) << "tile " << i;
    }
    system_calls().start();
    const std::vector<std::string> ids = store_->adopt(files);
    const std::vector<std::string> calls = system_calls().stop();
    std::vector<std::string> expected(20, "rename");  // out of the folder of the job
    expected.emplace_back("sync all");
    expected.insert(expected.end(), 20, "rename");
    expected.emplace_back("sync all");
    EXPECT_EQ(calls, expected);
    for (std::size_t i = 0; i < ids.size(); ++i)
        EXPECT_EQ(text_of(*store_->open(ids[i])), "tile " + std::to_string(i));
    EXPECT_EQ(temporary_files(), 0U);
}

TEST_F(FileBlobStore, TakesNoneOfManyFilesWhereOneIsMissing) {
    std::vector<fs::path> files(20, folder_ / "tile");
    std::ofstream(files[0]) << "tile";
    EXPECT_THROW(store_->adopt(files), Error);
    EXPECT_FALSE(store_->open(proto::sha256_hex(bytes_of("tile"))));
    EXPECT_EQ(temporary_files(), 0U);
}

TEST_F(FileBlobStore, AdoptsNoLinkToAnotherFile) {
    std::ofstream(folder_ / "secret") << "secret";
    fs::create_symlink(folder_ / "secret", folder_ / "symbolic");
    fs::create_hard_link(folder_ / "secret", folder_ / "hard");
    EXPECT_THROW(store_->adopt(folder_ / "symbolic"), Error);
    EXPECT_THROW(store_->adopt(folder_ / "hard"), Error);
    EXPECT_THROW(store_->adopt(folder_ / "missing"), Error);
    EXPECT_FALSE(store_->open(proto::sha256_hex(bytes_of("secret"))));
    EXPECT_EQ(temporary_files(), 0U);
}

TEST_F(FileBlobStore, RemovesOnlyWhatWasNotCommittedAgain) {
    const std::string id = put_blob(*store_, "abc");
    const auto after_first = system_clock::now() + std::chrono::milliseconds(20);
    std::this_thread::sleep_until(after_first + std::chrono::milliseconds(20));
    put_blob(*store_, "abc");
    EXPECT_EQ(store_->older_than(after_first), std::vector<std::string>{});
    EXPECT_FALSE(store_->remove_older(id, after_first));
    EXPECT_TRUE(store_->remove_older(id, system_clock::now() + std::chrono::hours(1)));
    EXPECT_FALSE(store_->open(id));
}

TEST_F(FileBlobStore, LetsAReaderKeepABlobThatIsRemoved) {
    const std::string id = put_blob(*store_, "abc");
    const auto blob = store_->open(id);
    ASSERT_TRUE(store_->remove_older(id, system_clock::now() + std::chrono::hours(1)));
    EXPECT_EQ(text_of(*blob), "abc");
}

TEST_F(FileBlobStore, TellsThatABlobBecameShorterAfterItWasOpened) {
    const auto blob = store_->open(put_blob(*store_, "abc"));
    EXPECT_EQ(read_all(*blob).size(), 3U);
    fs::permissions(blob->path(), fs::perms::owner_write, fs::perm_options::add);
    fs::resize_file(blob->path(), 2);
    expect_error(ErrorCode::Internal, "its bytes end after 2 of 3", [&] { read_all(*blob); });
}

TEST_F(FileBlobStore, ProbesThatItCanWrite) {
    EXPECT_NO_THROW(store_->probe());
    EXPECT_EQ(temporary_files(), 0U);
    fs::remove_all(folder_ / "tmp");
    expect_error(ErrorCode::Internal, "cannot create", [&] { store_->probe(); });
}

TEST(PosixFile, SaysThatTheStorageIsFull) {
    const FileDescriptor full = open_file("/dev/full", O_WRONLY);
    ASSERT_TRUE(full);
    expect_error(ErrorCode::Internal,
                 "storage full: ", [&] { write_all(full, bytes_of("abc"), "/dev/full"); });
    EXPECT_THROW(write_all(full, bytes_of("abc"), "/dev/full"), proto::StorageFull);
}

TEST(PosixFile, SaysWhichFileCannotBeUsedAndWhy) {
    expect_error(ErrorCode::Internal, "cannot open /nowhere: No such file or directory",
                 [] { sync_folder("/nowhere"); });
}

/// A disk of 256 KiB, where the tests may mount one.
class SmallDisk {
public:
    SmallDisk() : mounted_(::mount("tmpfs", path().c_str(), "tmpfs", 0, "size=256k") == 0) {}
    ~SmallDisk() {
        if (mounted_) ::umount2(path().c_str(), MNT_DETACH);
    }
    SmallDisk(const SmallDisk&) = delete;
    SmallDisk& operator=(const SmallDisk&) = delete;
    bool mounted() const { return mounted_; }
    const fs::path& path() const { return folder_.path(); }

private:
    TemporaryFolder folder_;
    bool mounted_;
};

TEST(FileBlobStoreOnAFullDisk, SaysSoKeepsNothingAndGoesOnWhenThereIsRoomAgain) {
    const SmallDisk disk;
    if (!disk.mounted()) GTEST_SKIP() << "mounting a small disk needs root";
    const auto store = open_file_blob_store(disk.path());
    const std::string large(512 * 1024, 'x');
    expect_error(ErrorCode::Internal, "storage full: ", [&] { put_blob(*store, large); });
    EXPECT_EQ(text_of(*store->open(put_blob(*store, "abc"))), "abc");
}

TEST(FileBlobStoreOnAFullDisk, KeepsTheLastOfItForRemovals) {
    const SmallDisk disk;
    if (!disk.mounted()) GTEST_SKIP() << "mounting a small disk needs root";
    const auto store = open_file_blob_store(disk.path());
    EXPECT_NO_THROW(store->check_room());
    std::ofstream(disk.path() / "ballast") << std::string(244 * 1024, 'x');  // of 256 KiB
    expect_error(ErrorCode::Internal, "storage full: ", [&] { store->check_room(); });
    EXPECT_THROW(store->check_room(), proto::StorageFull);
    expect_error(ErrorCode::Internal, "storage full: ", [&] { put_blob(*store, "abc"); });
    EXPECT_NO_THROW(store->probe());
}

}  // namespace
}  // namespace stipple::server
