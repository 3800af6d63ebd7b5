#include "http/api.hpp"

#include "store_fixtures.hpp"

namespace stipple::server::http {
namespace {

using namespace stipple::test;

TEST(Api, LogsWhoBrokeAReplyOff) {
    const TemporaryFolder folder;
    const auto blobs = open_file_blob_store(folder / "blobs");
    const auto jobs = open_sqlite_job_store(folder / "jobs.sqlite");
    Service service({}, *jobs, *blobs);
    Metrics metrics;
    Api api({}, service, metrics);
    const Log log;
    Request request;
    request.id = "7";
    api.served(request, {.complete = true});
    EXPECT_EQ(log.text().find("reply=broken"), std::string::npos);
    EXPECT_EQ(log.text().find("client=gone"), std::string::npos);
    api.served(request, {.complete = false, .failure = "scan.ply: away"});
    EXPECT_NE(log.text().find("reply.broken id=7 route=none reason=\"scan.ply: away\""),
              std::string::npos)
        << log.text();
    EXPECT_NE(log.text().find("reply=broken"), std::string::npos);
    EXPECT_EQ(log.text().find("client=gone"), std::string::npos);
    api.served(request, {.complete = false});
    EXPECT_NE(log.text().find("client=gone"), std::string::npos);
}

}  // namespace
}  // namespace stipple::server::http
