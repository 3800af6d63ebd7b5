#pragma once

#include "http/message.hpp"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

namespace stipple::server::http {

/// How many requests of a kind there may be at a time.
struct Places {
    unsigned all = 1;
    unsigned of_address = all;
    unsigned of_tenant = all;  ///< where there are others
};

/// Whom a server is for.
struct Senders {
    unsigned connections = 512;
    unsigned of_address = 128;  ///< connections of one
};

/// Of `all` places one address may hold the share that it may hold of the connections (all of them
/// behind a proxy), and one tenant a quarter while there are others; each at least two, if there
/// are two.
constexpr Places places_among(const Senders& senders, unsigned all) noexcept {
    const auto part_of = [all](std::uint64_t part, std::uint64_t whole) {
        const std::uint64_t places = (all * part + whole - 1) / whole;
        return static_cast<unsigned>(std::clamp<std::uint64_t>(places, std::min(2U, all), all));
    };
    return {.all = all,
            .of_address = part_of(senders.of_address, senders.connections),
            .of_tenant = part_of(1, 4)};
}

/// Places for requests of a kind that may hold their thread for long. Together the kinds have fewer
/// places than there are threads, so that short requests always find one; and no sender can take
/// all of a kind.
class Permits {
public:
    Permits(std::string kind, const Places& places,
            std::chrono::milliseconds patience = std::chrono::seconds(1))
        : kind_(std::move(kind)), places_(places), patience_(patience) {}

    /// Held while the returned object lives. Waits a moment for a place, since most are free again
    /// soon: the thread is that of the sender's own connection.
    /// @throws HttpError(503) with `Retry-After` when there is none then.
    std::shared_ptr<void> take(const Request& request) {
        auto place = std::make_shared<Place>(request);
        std::unique_lock lock(mutex_);
        const auto is_free = [&] { return !what_is_full(request); };
        if (!freed_.wait_for(lock, patience_, is_free)) throw refusal(*what_is_full(request));
        // What may throw comes first: a place that is taken is always given back.
        unsigned& of_address = of_address_[request.remote_address];
        unsigned& of_tenant = of_tenant_[request.tenant];
        ++taken_, ++of_address, ++of_tenant;
        place->permits = this;
        return place;
    }

private:
    using Taken = std::map<std::string, unsigned, std::less<>>;

    struct Place {
        std::string address, tenant;
        Permits* permits = nullptr;  ///< once it is taken

        explicit Place(const Request& request)
            : address(request.remote_address), tenant(request.tenant) {}
        Place(const Place&) = delete;
        Place& operator=(const Place&) = delete;
        ~Place() {
            if (permits != nullptr) permits->give_back(address, tenant);
        }
    };

    /// Who has as many places as they may, in words.
    std::optional<std::string> what_is_full(const Request& request) const {
        const auto taken_by = [](const Taken& taken, const std::string& name) {
            const auto found = taken.find(name);
            return found == taken.end() ? 0U : found->second;
        };
        const std::string all = std::to_string(places_.all) + " places for " + kind_;
        if (taken_ >= places_.all) return "all " + all + " are taken";
        if (taken_by(of_address_, request.remote_address) >= places_.of_address)
            return "your address has " + std::to_string(places_.of_address) + " of the " + all +
                   ", its limit";
        if (request.tenants > 1 && taken_by(of_tenant_, request.tenant) >= places_.of_tenant)
            return "tenant " + request.tenant + " has " + std::to_string(places_.of_tenant) +
                   " of the " + all + ", its limit";
        return std::nullopt;
    }

    static HttpError refusal(const std::string& full) {
        proto::Problem problem = proto::problem_from_status(503, full + ": try again later");
        problem.retry_after = 2;
        return HttpError(std::move(problem));
    }

    void give_back(const std::string& address, const std::string& tenant) {
        const auto drop = [](Taken& taken, const std::string& name) {
            const auto found = taken.find(name);
            if (--found->second == 0) taken.erase(found);
        };
        {
            const std::lock_guard lock(mutex_);
            --taken_;
            drop(of_address_, address);
            drop(of_tenant_, tenant);
        }
        freed_.notify_all();
    }

    const std::string kind_;
    const Places places_;
    const std::chrono::milliseconds patience_;
    std::mutex mutex_;  ///< for all below
    std::condition_variable freed_;
    unsigned taken_ = 0;
    Taken of_address_, of_tenant_;
};

}  // namespace stipple::server::http
