#include <stipple/client.hpp>
#include <stipple/codec.hpp>
#include <stipple/simplify.hpp>
#include <stipple/synthetic_scan.hpp>

#include <iostream>

int main() {
    const stipple::PointCloud cloud = stipple::synthetic_scan({.points = 5000});
    stipple::SimplifyOptions options;
    options.points = 123;
    const std::vector<std::byte> file = stipple::encode_draco(stipple::simplify(cloud, options));
    const std::size_t points = stipple::decode_cloud(file).size();
    const stipple::Client client("http://127.0.0.1:8080");  // connects to nothing yet
    std::cout << points << " points\n";
    return points == 123 ? 0 : 1;
}
