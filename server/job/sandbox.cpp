#include "sandbox.hpp"

#include "stipple/error.hpp"

#include <linux/prctl.h>
#include <malloc.h>
#include <sched.h>
#include <seccomp.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>
#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>

// Why a list of what is allowed, and ENOSYS for the rest: a list of what is forbidden ages with
// every kernel, and killing the process makes it age with every C library. To a call that does not
// exist a C library has an answer: glibc takes clone where clone3 is missing, TBB does without what
// it cannot learn of the machine. Nothing a job needs is newer than Linux 4.
//
// Limits come first, since the filter does not let them be changed afterwards.

namespace stipple::job {

namespace {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kSanitized = true;  // sanitizers map terabytes, and look at themselves from outside
#else
constexpr bool kSanitized = false;
#endif

constexpr rlim_t kOpenFiles = 64;

Error system_error(const std::string& what, int code) {
    return Error(ErrorCode::Internal, what + ": " + std::strerror(code));
}

void limit(int resource, const char* name, rlim_t soft, rlim_t hard) {
    rlimit current{};
    ::getrlimit(static_cast<__rlimit_resource_t>(resource), &current);
    const rlimit wanted{std::min(soft, current.rlim_max), std::min(hard, current.rlim_max)};
    if (::setrlimit(static_cast<__rlimit_resource_t>(resource), &wanted) != 0) {
        throw system_error(std::string("cannot set ") + name, errno);
    }
}

/// Inputs are mapped, not loaded, candidates one after the other: they lie in the address space but
/// are no memory of the job's.
std::uint64_t mapped_bytes(const proto::JobSpec& spec) {
    const auto size_of = [](const std::string& file) -> std::uint64_t {
        std::error_code missing;  // is told by whoever opens the file
        const auto size = std::filesystem::file_size(file, missing);
        return missing ? 0 : size;
    };
    std::uint64_t largest_candidate = 0;
    for (const std::string& file : spec.candidate_files)
        largest_candidate = std::max(largest_candidate, size_of(file));
    return size_of(spec.input_file) + largest_candidate;
}

/// Every heap of malloc reserves 64 MiB of address space: with one a core they would use up the
/// limit on a large machine. They may have a quarter of it.
int heaps_within(std::uint64_t memory) {
    constexpr std::uint64_t kReserved = 64ULL << 20, kMost = 8;
    if (memory == 0) return kMost;
    return static_cast<int>(std::clamp<std::uint64_t>(memory / (4 * kReserved), 1, kMost));
}

class Filter {
public:
    Filter() : context_(::seccomp_init(SCMP_ACT_ERRNO(ENOSYS)), &::seccomp_release) {
        if (!context_) throw Error(ErrorCode::Internal, "seccomp_init failed");
    }

    template <typename... Conditions>
    void allow(int call, Conditions... conditions) {
        const int failed = ::seccomp_rule_add(context_.get(), SCMP_ACT_ALLOW, call,
                                              sizeof...(conditions), conditions...);
        if (failed != 0) throw system_error("seccomp_rule_add", -failed);
    }

    void load() {
        const int failed = ::seccomp_load(context_.get());
        if (failed != 0) throw system_error("seccomp_load", -failed);
    }

private:
    std::unique_ptr<void, decltype(&::seccomp_release)> context_;
};

void allow_memory(Filter& filter) {
    for (const int call : {SCMP_SYS(brk), SCMP_SYS(mmap), SCMP_SYS(munmap), SCMP_SYS(mremap),
                           SCMP_SYS(mprotect), SCMP_SYS(madvise)}) {
        filter.allow(call);
    }
}

/// Threads, but no processes: clone only with CLONE_THREAD, and not clone3, whose flags a filter
/// cannot see.
void allow_threads(Filter& filter) {
    for (const int call :
         {SCMP_SYS(futex), SCMP_SYS(set_robust_list), SCMP_SYS(rseq), SCMP_SYS(sched_yield),
          SCMP_SYS(sched_getaffinity), SCMP_SYS(sched_setaffinity), SCMP_SYS(sched_getparam),
          SCMP_SYS(sched_getscheduler), SCMP_SYS(getcpu), SCMP_SYS(exit), SCMP_SYS(exit_group)}) {
        filter.allow(call);
    }
    filter.allow(SCMP_SYS(clone), SCMP_A0(SCMP_CMP_MASKED_EQ, CLONE_THREAD, CLONE_THREAD));
}

/// Files by name are the job's: it runs as whom its starter chose, and the folder is all it is told
/// of.
void allow_files(Filter& filter) {
    for (const int call :
         {SCMP_SYS(open),      SCMP_SYS(openat),     SCMP_SYS(close),      SCMP_SYS(read),
          SCMP_SYS(readv),     SCMP_SYS(pread64),    SCMP_SYS(write),      SCMP_SYS(writev),
          SCMP_SYS(pwrite64),  SCMP_SYS(lseek),      SCMP_SYS(fstat),      SCMP_SYS(stat),
          SCMP_SYS(lstat),     SCMP_SYS(newfstatat), SCMP_SYS(statx),      SCMP_SYS(access),
          SCMP_SYS(faccessat), SCMP_SYS(readlink),   SCMP_SYS(readlinkat), SCMP_SYS(getdents64),
          SCMP_SYS(fcntl),     SCMP_SYS(rename),     SCMP_SYS(renameat),   SCMP_SYS(renameat2),
          SCMP_SYS(unlink),    SCMP_SYS(unlinkat),   SCMP_SYS(fsync),      SCMP_SYS(ftruncate),
          SCMP_SYS(fadvise64)}) {
        filter.allow(call);
    }
}

void allow_clocks_and_facts(Filter& filter) {
    for (const int call :
         {SCMP_SYS(clock_gettime), SCMP_SYS(clock_nanosleep), SCMP_SYS(nanosleep),
          SCMP_SYS(gettimeofday), SCMP_SYS(getrusage), SCMP_SYS(getrandom), SCMP_SYS(sysinfo),
          SCMP_SYS(uname), SCMP_SYS(getpid), SCMP_SYS(gettid), SCMP_SYS(getuid), SCMP_SYS(geteuid),
          SCMP_SYS(getgid), SCMP_SYS(getegid)}) {
        filter.allow(call);
    }
    // Limits can be read, not set.
    filter.allow(SCMP_SYS(prlimit64), SCMP_A0(SCMP_CMP_EQ, 0), SCMP_A2(SCMP_CMP_EQ, 0));
}

void allow_signals_to_itself(Filter& filter) {
    for (const int call : {SCMP_SYS(rt_sigaction), SCMP_SYS(rt_sigprocmask), SCMP_SYS(rt_sigreturn),
                           SCMP_SYS(sigaltstack), SCMP_SYS(restart_syscall)}) {
        filter.allow(call);
    }
    filter.allow(SCMP_SYS(tgkill),
                 SCMP_A0(SCMP_CMP_EQ, static_cast<scmp_datum_t>(::getpid())));  // abort()
}

}  // namespace

void set_limits(const proto::JobSpec& spec) {
    ::mallopt(M_ARENA_MAX, heaps_within(spec.max_memory_bytes));
    if (spec.max_memory_bytes != 0 && !kSanitized) {
        const rlim_t bytes = spec.max_memory_bytes + mapped_bytes(spec);
        limit(RLIMIT_AS, "RLIMIT_AS", bytes, bytes);
    }
    if (spec.max_cpu_seconds != 0) {
        // SIGXCPU lets the process say why; SIGKILL comes two seconds later if it does not.
        limit(RLIMIT_CPU, "RLIMIT_CPU", spec.max_cpu_seconds, spec.max_cpu_seconds + 2);
    }
    if (spec.max_file_bytes != 0) {
        limit(RLIMIT_FSIZE, "RLIMIT_FSIZE", spec.max_file_bytes, spec.max_file_bytes);
        std::signal(SIGXFSZ, SIG_IGN);  // so that the write fails, and the job can say so
    }
    limit(RLIMIT_NOFILE, "RLIMIT_NOFILE", kOpenFiles, kOpenFiles);
    limit(RLIMIT_CORE, "RLIMIT_CORE", 0, 0);
    // Where memory runs out the kernel ends a job, not the server; without /proc nothing is lost.
    std::ofstream("/proc/self/oom_score_adj") << 1000;
}

void die_with(int parent) {
    if (::prctl(PR_SET_PDEATHSIG, SIGKILL) != 0) throw system_error("PR_SET_PDEATHSIG", errno);
    // It may have died before the line above: then this process has another parent by now.
    if (::getppid() != parent) ::_exit(1);
}

void enter_sandbox() {
    if (kSanitized) return;
    if (::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) {
        throw system_error("PR_SET_NO_NEW_PRIVS", errno);
    }
    Filter filter;
    allow_memory(filter);
    allow_threads(filter);
    allow_files(filter);
    allow_clocks_and_facts(filter);
    allow_signals_to_itself(filter);
    filter.load();
}

}  // namespace stipple::job
