#pragma once

#include "stipple/error.hpp"

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <string_view>

namespace stipple::cli {

/// A place in a bucket of S3, or of any store that speaks its protocol: `s3://NAME/PREFIX`.
struct BucketAddress {
    std::string name;
    std::string prefix{};  ///< empty, or ends with a slash
};
/// Nothing for a text that does not begin with `s3://`. @throws Error(InvalidArgument) for one
/// whose name no bucket can have.
std::optional<BucketAddress> bucket_address(std::string_view text);

/// Who may write there, and where `there` is.
struct BucketAccess {
    std::string key_id, secret;
    std::string session_token{};  ///< of keys that expire; else empty
    std::string region = "us-east-1";
    std::string endpoint{};  ///< `https://HOST[:PORT]`, no slash at its end; empty: that of AWS
};
/// As the tools of AWS read it: AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_SESSION_TOKEN,
/// AWS_REGION or AWS_DEFAULT_REGION, AWS_ENDPOINT_URL_S3 or AWS_ENDPOINT_URL.
/// @param variable  the value of one, or null. @throws Error(InvalidArgument) naming what is
/// missing.
BucketAccess bucket_access(const std::function<const char*(const char*)>& variable);

/// `https://NAME.s3.REGION.amazonaws.com/KEY`; of another endpoint, and of a name with a dot, which
/// no certificate covers, `ENDPOINT/NAME/KEY`. The key is percent-encoded.
std::string object_url(const BucketAddress& bucket, const BucketAccess& access,
                       std::string_view key);

/// Asks before the work is done whether the bucket is there and the keys are known to it.
/// @throws Error where the store cannot be reached, or says what is wrong.
void require_bucket(const BucketAddress& bucket, const BucketAccess& access);

/// A file that is to be put into a bucket.
struct BucketObject {
    std::filesystem::path file;
    std::string key;  ///< below the prefix
    std::string media_type, cache_control;
};

/// Stopped when some of the objects were there.
class PartlyPut : public Cancelled {
public:
    const char* what() const noexcept override {
        return "stopped; some files are in the bucket, but none that lists them";
    }
};

/// Puts all of them, several at a time, each signed with its hash (AWS Signature 4), and tries
/// those anew that failed for a reason that passes: up to four times, with pauses in between.
/// @param on_bytes  told how many bytes have been sent, of all; on the calling thread.
/// @throws Error(Internal) where the store cannot be reached, or goes on failing;
/// Error(InvalidArgument) with the store's own words where it refuses, or for a file above 5 GiB,
/// the most that one request may put; Cancelled.
void put_objects(const BucketAddress& bucket, const BucketAccess& access,
                 std::span<const BucketObject> objects,
                 const std::function<void(std::uint64_t)>& on_bytes, const std::stop_token& stop);

}  // namespace stipple::cli
