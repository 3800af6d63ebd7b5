#include "stipple/heap.hpp"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>

namespace stipple {
namespace {

/// The flags of the mapping that holds an address, as /proc/self/smaps has them.
std::optional<std::string> flags_at(const void* address) {
    const auto place = reinterpret_cast<std::uintptr_t>(address);
    std::ifstream in("/proc/self/smaps");
    bool is_inside = false;
    for (std::string line; std::getline(in, line);) {
        std::uintptr_t begin = 0, end = 0;
        char dash = 0;
        std::istringstream range(line);
        if (range >> std::hex >> begin >> dash >> end && dash == '-')
            is_inside = begin <= place && place < end;
        if (is_inside && line.starts_with("VmFlags:")) return line + ' ';
    }
    return {};
}

TEST(Heap, MemoryOfEverySizeLiesInHugePages) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    GTEST_SKIP() << "a sanitizer's heap is its own";
#endif
    if (!std::ifstream("/sys/kernel/mm/transparent_hugepage/enabled"))
        GTEST_SKIP() << "this system has no transparent huge pages";
    GTEST_FLAG_SET(death_test_style, "threadsafe");  // in a process that has no heap yet
    const auto count_huge = [] {
        prefer_huge_heap();
        int huge = 0;
        // The first fills what of the heap lies before its first huge page.
        for (const std::size_t kib : {2'304U, 200U, 3'000U, 30'000U}) {
            const void* const memory = std::malloc(kib << 10U);
            const auto flags = flags_at(memory);
            huge += flags && flags->find(" hg ") != std::string::npos ? 1 : 0;
        }
        std::exit(huge);
    };
    const auto all_but_the_first = [](int status) {
        return WIFEXITED(status) && WEXITSTATUS(status) >= 3;
    };
    EXPECT_EXIT(count_huge(), all_but_the_first, "");
}

}  // namespace
}  // namespace stipple
