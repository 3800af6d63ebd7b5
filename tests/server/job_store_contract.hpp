#pragma once

#include "store_fixtures.hpp"

#include "store/job_store.hpp"

#include <functional>
#include <stdexcept>
#include <thread>

namespace stipple::server {

/// What every job store promises. Another database joins by one more line in `backends`.
struct Backend {
    const char* name;
    std::function<std::unique_ptr<JobStore>(const test::TemporaryFolder&)> open;
};

class JobStoreContract : public testing::TestWithParam<Backend> {
protected:
    void reopen() {
        store_.reset();
        store_ = GetParam().open(folder_);
    }
    proto::JobDocument submit(const std::string& tenant = "ada",
                              const std::optional<std::string>& key = {},
                              std::uint64_t points = 100) {
        const auto request =
            test::simplify_request(test::put_cloud(*store_, tenant, "cloud"), points);
        return store_->submit(tenant, request, key, limits_).document;
    }
    Lease claim(std::chrono::seconds lease_time = std::chrono::seconds(60)) {
        auto lease = store_->claim(limits_, lease_time);
        if (!lease) throw std::logic_error("nothing to claim");
        return *lease;
    }
    /// A lease that is over at once.
    Lease claim_for_a_moment() {
        const Lease lease = claim(std::chrono::seconds(0));
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
        return lease;
    }
    proto::JobDocument find(const std::string& id, const std::string& tenant = "ada") {
        return store_->find_job(tenant, id).value();
    }
    std::vector<std::string> events(const std::string& id) {
        std::vector<std::string> told;
        for (const JobEvent& event : store_->events_after("ada", id, 0)) {
            told.push_back(event.type == "status" ? event.data : event.type);
        }
        return told;
    }

    test::TemporaryFolder folder_;
    QueueLimits limits_;
    std::unique_ptr<JobStore> store_ = GetParam().open(folder_);
};

inline const std::string kHash(64, 'a');

inline auto backends() {
    return testing::Values(Backend{"Sqlite", [](const test::TemporaryFolder& folder) {
                                       return open_sqlite_job_store(folder / "jobs.sqlite");
                                   }});
}

}  // namespace stipple::server
