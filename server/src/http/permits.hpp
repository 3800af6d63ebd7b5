#pragma once

#include "http/message.hpp"

#include <atomic>
#include <memory>
#include <string>

namespace stipple::server::http {

/// Places for requests of a kind that may hold their thread for long. Together the kinds have fewer
/// places than there are threads, so that short requests always find one.
class Permits {
public:
    Permits(std::string kind, unsigned places) : kind_(std::move(kind)), places_(places) {}

    /// Held while the returned object lives. @throws HttpError(503) with `Retry-After` when all are
    /// taken.
    std::shared_ptr<void> take() {
        if (taken_.fetch_add(1) >= places_) {
            taken_.fetch_sub(1);
            proto::Problem problem =
                proto::problem_from_status(503, "all " + std::to_string(places_) + " places for " +
                                                    kind_ + " are taken: try again later");
            problem.retry_after = 2;
            throw HttpError(std::move(problem));
        }
        return {this, [](Permits* permits) { permits->taken_.fetch_sub(1); }};
    }

private:
    const std::string kind_;
    const unsigned places_;
    std::atomic<unsigned> taken_ = 0;
};

}  // namespace stipple::server::http
