#include "models.hpp"

#include "stipple/cleaning.hpp"

#include <unistd.h>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <numbers>
#include <random>
#include <sstream>
#include <stdexcept>

namespace stipple::bench {

namespace fs = std::filesystem;

namespace {

struct Property {
    std::string name;
    std::string type;
    std::string count_type;  // empty unless it is a list
};

struct Element {
    std::string name;
    std::size_t count = 0;
    std::vector<Property> properties;
};

/// The body of a PLY file as a row of numbers.
class NumberReader {
public:
    NumberReader(std::string bytes, std::size_t at, bool ascii)
        : bytes_(std::move(bytes)), at_(at), ascii_(ascii) {}

    double next(const std::string& type) {
        if (ascii_) return next_ascii();
        if (type == "float" || type == "float32") return next_binary<float>();
        if (type == "double" || type == "float64") return next_binary<double>();
        if (type == "uchar" || type == "uint8") return next_binary<std::uint8_t>();
        if (type == "char" || type == "int8") return next_binary<std::int8_t>();
        if (type == "ushort" || type == "uint16") return next_binary<std::uint16_t>();
        if (type == "short" || type == "int16") return next_binary<std::int16_t>();
        if (type == "int" || type == "int32") return next_binary<std::int32_t>();
        if (type == "uint" || type == "uint32") return next_binary<std::uint32_t>();
        throw std::runtime_error("PLY type " + type);
    }

private:
    double next_ascii() {
        char* end = nullptr;
        const double value = std::strtod(bytes_.c_str() + at_, &end);
        at_ = static_cast<std::size_t>(end - bytes_.c_str());
        return value;
    }

    template <typename T>
    double next_binary() {
        static_assert(std::endian::native == std::endian::little);
        if (at_ + sizeof(T) > bytes_.size()) throw std::runtime_error("PLY file is too short");
        T value;
        std::memcpy(&value, bytes_.data() + at_, sizeof(T));
        at_ += sizeof(T);
        return static_cast<double>(value);
    }

    std::string bytes_;
    std::size_t at_;
    bool ascii_;
};

std::vector<Element> read_header(std::istream& in, bool& ascii) {
    std::vector<Element> elements;
    for (std::string line; std::getline(in, line) && line != "end_header";) {
        std::istringstream words(line);
        std::string keyword, word;
        words >> keyword >> word;
        if (keyword == "format") {
            ascii = word == "ascii";
            if (!ascii && word != "binary_little_endian")
                throw std::runtime_error("PLY format " + word);
        } else if (keyword == "element") {
            elements.push_back({word, 0, {}});
            words >> elements.back().count;
        } else if (keyword == "property") {
            Property property{.name = {}, .type = word, .count_type = {}};
            if (word == "list") words >> property.count_type >> property.type;
            words >> property.name;
            elements.back().properties.push_back(property);
        }
    }
    return elements;
}

bool is_ascii(const fs::path& file) {
    std::ifstream in(file, std::ios::binary);
    bool ascii = false;
    read_header(in, ascii);
    return ascii;
}

void add_fan(const std::vector<double>& polygon, TriangleMesh& mesh) {
    for (std::size_t i = 2; i < polygon.size(); ++i)
        mesh.triangles.push_back({static_cast<Index>(polygon[0]),
                                  static_cast<Index>(polygon[i - 1]),
                                  static_cast<Index>(polygon[i])});
}

/// Strips one after the other, each ended by -1.
void add_strips(const std::vector<double>& strips, TriangleMesh& mesh) {
    for (std::size_t i = 2; i < strips.size(); ++i) {
        const double a = strips[i - 2], b = strips[i - 1], c = strips[i];
        if (a < 0 || b < 0 || c < 0 || a == b || b == c || a == c) continue;
        mesh.triangles.push_back(
            {static_cast<Index>(a), static_cast<Index>(b), static_cast<Index>(c)});
    }
}

void read_element(const Element& element, NumberReader& in, TriangleMesh& mesh) {
    std::vector<double> list;
    for (std::size_t i = 0; i < element.count; ++i) {
        Vec3d position = Vec3d::Zero();
        for (const Property& property : element.properties) {
            if (property.count_type.empty()) {
                const double value = in.next(property.type);
                const auto axis = std::string_view("xyz").find(property.name);
                if (property.name.size() == 1 && axis != std::string_view::npos)
                    position[static_cast<Eigen::Index>(axis)] = value;
                continue;
            }
            list.resize(static_cast<std::size_t>(in.next(property.count_type)));
            for (double& value : list) value = in.next(property.type);
            if (element.name == "face") add_fan(list, mesh);
            if (element.name == "tristrips") add_strips(list, mesh);
        }
        if (element.name == "vertex") mesh.vertices.push_back(position);
    }
}

template <typename T>
void put(std::ofstream& out, T value) {
    out.write(reinterpret_cast<const char*>(&value), sizeof(T));
}

/// Positions in single precision and triangles, as scans are usually passed on.
void write_ply(const TriangleMesh& mesh, const fs::path& file, bool ascii) {
    std::ofstream out(file, std::ios::binary);
    out << "ply\nformat " << (ascii ? "ascii" : "binary_little_endian") << " 1.0\nelement vertex "
        << mesh.vertices.size()
        << "\nproperty float x\nproperty float y\nproperty float z\nelement face "
        << mesh.triangles.size() << "\nproperty list uchar int vertex_indices\nend_header\n";
    for (const Vec3d& v : mesh.vertices) {
        const Vec3f p = v.cast<float>();
        if (ascii)
            out << p.x() << ' ' << p.y() << ' ' << p.z() << '\n';
        else
            for (const float coordinate : p) put(out, coordinate);
    }
    for (const auto& triangle : mesh.triangles) {
        if (ascii) {
            out << "3 " << triangle[0] << ' ' << triangle[1] << ' ' << triangle[2] << '\n';
            continue;
        }
        put(out, std::uint8_t{3});
        for (const Index corner : triangle) put(out, static_cast<std::int32_t>(corner));
    }
    if (!out.flush()) throw std::runtime_error("cannot write " + file.string());
}

TriangleMesh points_of(const PointCloud& cloud) {
    TriangleMesh mesh;
    for (const Vec3f& p : cloud.positions) mesh.vertices.push_back(p.cast<double>());
    return mesh;
}

fs::path make_temporary_folder() {
    std::string name = (fs::temp_directory_path() / "stipple-bench-XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("mkdtemp " + name);
    return name;
}

/// The file, unpacked into `temporary` when there is only its `.gz`; empty when there is neither.
fs::path find_scan(const fs::path& file, const fs::path& temporary) {
    if (fs::exists(file)) return file;
    const fs::path packed = file.string() + ".gz";
    if (!fs::exists(packed)) return {};
    const fs::path unpacked = temporary / file.filename();
    const std::string command = "gzip -dc '" + packed.string() + "' > '" + unpacked.string() + "'";
    if (std::system(command.c_str()) != 0) throw std::runtime_error("failed: " + command);
    return unpacked;
}

/// The bumpy sphere's distance from the middle in a direction, and how it changes with it.
struct Radius {
    double value = 1;
    Vec3d gradient = Vec3d::Zero();
};

Radius radius(const Vec3d& direction) {
    Radius sum;
    const auto add = [&](double height, const Vec3d& frequency, const Vec3d& phase) {
        const Vec3d angle = frequency.cwiseProduct(direction) + phase;
        const Vec3d s = angle.array().sin(), c = angle.array().cos();
        sum.value += height * s.prod();
        sum.gradient +=
            height * frequency.cwiseProduct(Vec3d(c.x() * s.y() * s.z(), s.x() * c.y() * s.z(),
                                                  s.x() * s.y() * c.z()));
    };
    add(0.08, {9, 7, 8}, {0, 1, 2});
    add(0.01, {31, 37, 29}, {2, 0, 1});
    return sum;
}

/// `250k` and `2M` as numbers; 0 for what is not one.
std::size_t points_named(const std::string& name) {
    std::size_t used = 0, points = 0;
    try {
        points = std::stoul(name, &used);
    } catch (const std::logic_error&) {
        return 0;
    }
    const std::string unit = name.substr(used);
    return unit == "k" ? 1000 * points : unit == "M" ? 1'000'000 * points : 0;
}

}  // namespace

TriangleMesh read_triangles(const fs::path& file) {
    std::ifstream in(file, std::ios::binary);
    bool ascii = false;
    const std::vector<Element> elements = read_header(in, ascii);
    if (!in) throw std::runtime_error("no PLY header in " + file.string());
    const auto body = static_cast<std::size_t>(in.tellg());
    in.seekg(0);
    NumberReader numbers(std::string(std::istreambuf_iterator<char>(in), {}), body, ascii);
    TriangleMesh mesh;
    for (const Element& element : elements) read_element(element, numbers, mesh);
    return mesh;
}

PointCloud bumpy_sphere(std::size_t n, std::uint64_t seed) {
    // A jittered Fibonacci lattice: even, as a registered and filtered scan is, without being
    // regular.
    std::mt19937_64 random(seed);
    const double golden_angle = std::numbers::pi * (3.0 - std::sqrt(5.0));
    const double spacing = std::sqrt(4.0 * std::numbers::pi / static_cast<double>(n));
    std::uniform_real_distribution<double> jitter(-0.3 * spacing, 0.3 * spacing);
    PointCloud cloud;
    cloud.positions.reserve(n);
    for (std::size_t i = 0; i < n; ++i) {
        const double z = 1.0 - (2.0 * static_cast<double>(i) + 1.0) / static_cast<double>(n);
        const double ring = std::sqrt(1.0 - z * z);
        const double angle = golden_angle * static_cast<double>(i);
        Vec3d direction(ring * std::cos(angle), ring * std::sin(angle), z);
        for (double& coordinate : direction) coordinate += jitter(random);
        direction.normalize();
        cloud.positions.push_back((radius(direction).value * direction).cast<float>());
    }
    return cloud;
}

TriangleMesh bumpy_sphere_mesh(unsigned n) {
    TriangleMesh mesh;
    for (unsigned side = 0; side < 6; ++side) {  // of a cube
        const auto first = static_cast<Index>(mesh.vertices.size());
        for (unsigned i = 0; i <= n; ++i)
            for (unsigned j = 0; j <= n; ++j) {
                const double u = std::tan((0.5 * i / n - 0.25) * std::numbers::pi);
                const double v = std::tan((0.5 * j / n - 0.25) * std::numbers::pi);
                const double sign = side % 2 == 0 ? 1 : -1;
                Vec3d direction;
                direction[side / 2] = sign;
                direction[(side / 2 + 1) % 3] = u;
                direction[(side / 2 + 2) % 3] = sign * v;
                direction.normalize();
                mesh.vertices.push_back(radius(direction).value * direction);
            }
        for (unsigned i = 0; i < n; ++i)
            for (unsigned j = 0; j < n; ++j) {
                const Index a = first + i * (n + 1) + j, b = a + n + 1;
                mesh.triangles.push_back({a, b, a + 1});
                mesh.triangles.push_back({a + 1, b, b + 1});
            }
    }
    return mesh;
}

Vec3d bumpy_sphere_foot(const Vec3d& q) {
    // The surface is |x| = radius(x / |x|). Each step goes to the foot on the tangent plane and
    // from there along its direction onto the surface.
    Vec3d x = radius(q.normalized()).value * q.normalized();
    for (int step = 0; step < 20; ++step) {
        const Vec3d d = x.normalized();
        const Radius r = radius(d);
        const Vec3d tangential = r.gradient - d.dot(r.gradient) * d;
        const Vec3d n = (d - tangential / x.norm()).normalized();
        const Vec3d on_plane = q - n.dot(q - x) * n;
        const Vec3d next = radius(on_plane.normalized()).value * on_plane.normalized();
        const double moved = (next - x).norm();
        x = next;
        if (moved < 1e-10) break;
    }
    return x;
}

Models::Models(fs::path folder) : folder_(std::move(folder)), temporary_(make_temporary_folder()) {}

Models::~Models() {
    std::error_code ignored;
    fs::remove_all(temporary_, ignored);
}

const Model& Models::get(const std::string& name) {
    const auto it = models_.find(name);
    return it != models_.end() ? it->second : models_.emplace(name, load(name)).first->second;
}

Model Models::load(const std::string& name) {
    Model model{.name = name, .cloud = {}, .mesh = {}, .foot = {}, .file = {}};
    std::size_t points = points_named(name);
    if (name == "igea") {
        model.file = find_scan(folder_ / "igea.ply", temporary_);
        points = 134'345;
    } else if (name == "dragon") {
        model.file = find_scan(folder_ / "dragon_vrip.ply", temporary_);
        points = 437'645;
    } else if (points == 0) {
        model.file = find_scan(name, temporary_);
        if (model.synthetic()) {
            throw std::invalid_argument("model " + name +
                                        ": expected igea, dragon, 250k, 2M... or a PLY file");
        }
    }
    if (model.synthetic()) {
        model.cloud = bumpy_sphere(points);
        model.mesh = bumpy_sphere_mesh(200);
        model.foot = bumpy_sphere_foot;
    } else {
        model.mesh = read_triangles(model.file);
        std::vector<Vec3d>& vertices = model.mesh.vertices;
        if (points == 0 && !vertices.empty()) {
            const Vec3d origin = vertices.front();
            for (Vec3d& v : vertices) v -= origin;
        }
        for (const Vec3d& v : vertices) model.cloud.positions.push_back(v.cast<float>());
    }
    clean(model.cloud);
    return model;
}

fs::path Models::ply_file(const std::string& name, bool ascii) {
    const Model& model = get(name);
    if (!model.synthetic() && is_ascii(model.file) == ascii) return model.file;
    const fs::path file = temporary_ / (name + (ascii ? "-ascii.ply" : "-binary.ply"));
    if (!fs::exists(file))
        write_ply(model.synthetic() ? points_of(model.cloud) : model.mesh, file, ascii);
    return file;
}

}  // namespace stipple::bench
