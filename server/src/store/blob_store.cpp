#include "store/blob_store.hpp"

#include "stipple/error.hpp"

namespace stipple::server {

std::vector<std::byte> read_all(const BlobReader& blob) {
    std::vector<std::byte> bytes(static_cast<std::size_t>(blob.size()));
    const std::size_t read = blob.read(0, bytes);
    if (read == bytes.size()) return bytes;
    throw Error(ErrorCode::Internal, blob.path().string() + ": its bytes end after " +
                                         std::to_string(read) + " of " +
                                         std::to_string(bytes.size()));
}

}  // namespace stipple::server
