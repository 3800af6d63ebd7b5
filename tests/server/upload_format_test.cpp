#include "service/upload_format.hpp"

#include "store_fixtures.hpp"

namespace stipple::server {
namespace {

using test::bytes_of;
using test::expect_error;

TEST(UploadFormat, IsToldByTheFirstBytes) {
    EXPECT_EQ(upload_format(bytes_of("ply\nformat ascii 1.0\n")), CloudFormat::Ply);
    EXPECT_EQ(upload_format(bytes_of("DRACO\x02\x02")), CloudFormat::Draco);
    EXPECT_EQ(upload_format(bytes_of("STPC\x01")), CloudFormat::Progressive);
}

TEST(UploadFormat, RefusesEveryOtherSayingWhatItProbablyIs) {
    const auto refused = [](std::string_view head, std::string_view reason) {
        expect_error(ErrorCode::UnsupportedFormat, reason,
                     [head] { (void)upload_format(bytes_of(head)); });
    };
    refused("", "the body is empty: expected");
    refused("hello", "neither PLY, Draco nor a progressive stream: expected it to begin");
    refused("plyformat ascii 1.0", "--data-binary");
    refused("\x1F\x8B\x08", "unpack it first");
    refused("PK\x03\x04", "unpack it first");
    refused("\x28\xB5\x2F\xFD", "unpack it first");
    refused("LASF", "convert it to PLY first");
    refused("glTF\x02", "nor a progressive stream");
}

}  // namespace
}  // namespace stipple::server
