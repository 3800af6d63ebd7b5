// The shell is the classic one of D. M. Raup, "Geometric Analysis of Shell Coiling" (1966): a tube
// whose distance from the axis and whose width both grow by a constant factor each turn. Ribs, keel
// and growth lines are modulations of the tube's width. Samples are drawn in proportion to area by
// inverting a tabulated distribution along the part and by rejection across it; the scanner (lines,
// holes, wear) only rejects more.

#include "stipple/synthetic_scan.hpp"

#include "base/parallel_for.hpp"
#include "base/refuse.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace stipple {
namespace {

// Mathematics that is the same everywhere: a library's sin and exp differ in their last bit from
// machine to machine.

/// sin(2 pi t), to 1e-11.
double sin_turns(double t) {
    t -= std::floor(t + 0.5);
    if (t > 0.25) t = 0.5 - t;
    if (t < -0.25) t = -0.5 - t;
    const double x = 2.0 * std::numbers::pi * t;
    double term = x, sum = x;
    for (int k = 3; k <= 15; k += 2) {
        term *= -x * x / (k * (k - 1));
        sum += term;
    }
    return sum;
}

double cos_turns(double t) {
    return sin_turns(t + 0.25);
}

/// 2^x, to 1e-12 of itself.
double power_of_two(double x) {
    const double whole = std::floor(x);
    const double y = (x - whole) * std::numbers::ln2;
    double term = 1.0, sum = 1.0;
    for (int k = 1; k <= 14; ++k) {
        term *= y / k;
        sum += term;
    }
    return std::ldexp(sum, static_cast<int>(whole));
}

double fraction(double x) {
    return x - std::floor(x);
}
double smooth(double x) {
    return x * x * (3.0 - 2.0 * x);
}
/// 0 between the crests, 1 on them; a crease at each.
double ridge(double x) {
    const double y = std::abs(2.0 * fraction(x) - 1.0);
    return y * y;
}

std::uint64_t mix(std::uint64_t x) {  // the finaliser of splitmix64
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
    return x ^ (x >> 31);
}

/// One generator for each point, so that no point waits for another.
class Random {
public:
    Random(std::uint64_t seed, std::uint64_t stream)
        : state_(mix(seed + 0x9e3779b97f4a7c15ULL) ^ mix(stream * 0xd1342543de82ef95ULL + 1)) {}

    double unit() {
        state_ += 0x9e3779b97f4a7c15ULL;
        return static_cast<double>(mix(state_) >> 11) * 0x1p-53;
    }
    /// Mean 0, deviation 1, within ±3.47: the sum of four uniform numbers, scaled.
    double bell() {
        const double sum = unit() + unit() + unit() + unit();
        return (sum - 2.0) * std::numbers::sqrt3;
    }

private:
    std::uint64_t state_;
};

/// Value noise in [0, 1]: random values on a unit lattice, blended.
double lattice_noise(const Vec3d& p, std::uint64_t seed) {
    const Vec3d cell(std::floor(p.x()), std::floor(p.y()), std::floor(p.z()));
    const Vec3d f(smooth(p.x() - cell.x()), smooth(p.y() - cell.y()), smooth(p.z() - cell.z()));
    double value = 0;
    for (unsigned corner = 0; corner < 8; ++corner) {
        std::uint64_t key = seed;
        double weight = 1;
        for (int axis = 0; axis < 3; ++axis) {
            const unsigned upper = (corner >> axis) & 1U;
            const auto at = static_cast<std::int64_t>(cell[axis]) + upper;
            key = mix(key + static_cast<std::uint64_t>(at) * 0x9e3779b97f4a7c15ULL + 1);
            weight *= upper != 0 ? f[axis] : 1.0 - f[axis];
        }
        value += weight * static_cast<double>(key >> 40) * 0x1p-24;
    }
    return value;
}

// The shell.

constexpr double kTurns = 5.0;
constexpr double kLog2Growth = 1.07;   // a whorl is 2.1 times as wide as the one inside it
constexpr double kMouthRadius = 70.0;  // mm, from the axis to the middle of the tube at the mouth
constexpr double kTubeRatio = 0.335;   // whorls touch at 0.355 plus ribs
constexpr double kFlatness = 0.80;     // thickness over height of the tube
constexpr double kMouthAngle = 0.08;   // turns above the horizontal
constexpr double kRibsPerTurn = 36.0;
constexpr double kWall = 0.09;  // thickness of the wall over the width of the tube
const Vec3d kShellCentre(0.0, 128.0, 0.0);

double distance_from_axis(double turn) {
    return kMouthRadius * power_of_two(kLog2Growth * (turn - kTurns));
}

double rib(double turn, double around) {
    return ridge(kRibsPerTurn * turn + 0.8 * cos_turns(around));
}

/// @param around  in turns: 0 at the keel, 0.5 at the whorl inside.
Vec3d shell(double turn, double around, double width) {
    const double outer = 0.5 + 0.5 * cos_turns(around);
    const double to_keel = std::abs(around - std::floor(around + 0.5));
    const double keel = std::max(0.0, 1.0 - to_keel / 0.035);
    const double relief = 1.0 + (0.02 + 0.06 * outer) * rib(turn, around) + 0.07 * keel +
                          0.004 * sin_turns(9.0 * kRibsPerTurn * turn);
    const double from_axis = distance_from_axis(turn);
    const double tube = kTubeRatio * from_axis * width * relief;
    const double reach = from_axis + tube * cos_turns(around);
    const double angle = turn - kTurns + kMouthAngle;
    return kShellCentre + Vec3d(reach * cos_turns(angle), reach * sin_turns(angle),
                                kFlatness * tube * sin_turns(around));
}

// The plinth: a profile swept around a rectangle, and the rod that carries the shell.

struct ProfilePoint {
    double half_width, height;
};
struct ProfileSegment {
    ProfilePoint from, to;
    double flute_depth;
};
constexpr double kFlutePitch = 4.7;
constexpr double kDepthOverWidth = 0.68;
constexpr std::array kProfile = {
    ProfileSegment{{62, 0}, {62, 11}, 0},  ProfileSegment{{62, 11}, {59, 14}, 0},
    ProfileSegment{{59, 14}, {50, 14}, 0}, ProfileSegment{{50, 14}, {47, 27}, 1.3},
    ProfileSegment{{54, 27}, {54, 32}, 0}, ProfileSegment{{54, 32}, {52, 34}, 0},
    ProfileSegment{{52, 34}, {0, 34}, 0},
};
constexpr double kRodRadius = 1.8;
constexpr double kRodFoot = 34.0, kRodHead = 60.0;

/// @param side  0..3; `across` in -1..1 along it.
Vec3d plinth(const ProfileSegment& segment, unsigned side, double along, double across) {
    const double half_width =
        segment.from.half_width + along * (segment.to.half_width - segment.from.half_width);
    const double height = segment.from.height + along * (segment.to.height - segment.from.height);
    const bool front = side % 2 == 0;
    const double half_length = half_width * (front ? 1.0 : kDepthOverWidth);
    const double distance = half_width * (front ? kDepthOverWidth : 1.0);
    const double flute = 2.0 * fraction(across * half_length / kFlutePitch) - 1.0;
    const double out = distance - segment.flute_depth * (1.0 - flute * flute);
    const double sign = side < 2 ? 1.0 : -1.0;
    return front ? Vec3d(sign * across * half_length, height, sign * out)
                 : Vec3d(sign * out, height, -sign * across * half_length);
}

Vec3d rod(double along, double around) {
    return {kRodRadius * cos_turns(around), kRodFoot + along * (kRodHead - kRodFoot),
            kRodRadius * sin_turns(around)};
}

// Samples.

enum class Part { Shell, InnerWall, Plinth, Rod };

struct Sample {
    Part part = Part::Shell;
    Vec3d position, normal;
    double turn = 0, around = 0;  // on the shell
};

/// The normal of a surface at (u, v), by differences: the side where du x dv points.
template <typename Surface>
Vec3d normal_at(const Surface& surface, double u, double v, double du, double dv) {
    const Vec3d along = surface(u + du, v) - surface(u - du, v);
    const Vec3d across = surface(u, v + dv) - surface(u, v - dv);
    const Vec3d normal = along.cross(across);
    const double length =
        std::sqrt(normal.x() * normal.x() + normal.y() * normal.y() + normal.z() * normal.z());
    return length > 0 ? Vec3d(normal / length) : Vec3d::UnitY();
}

/// Shares of the points; beside each other they make the density even.
constexpr double kShellShare = 0.72, kInnerWallShare = 0.05, kPlinthShare = 0.22;

class Ammonite {
public:
    explicit Ammonite(std::uint64_t seed) : seed_(seed) {
        area_up_to_.front() = 0;
        for (std::size_t i = 1; i < area_up_to_.size(); ++i) {
            const double from_axis = distance_from_axis(turn_of(static_cast<double>(i) - 0.5));
            area_up_to_[i] = area_up_to_[i - 1] + from_axis * from_axis;
        }
        for (double& area : area_up_to_) area /= area_up_to_.back();

        for (std::size_t i = 0; i < kProfile.size(); ++i) {
            const auto& [from, to, flutes] = kProfile[i];
            const double width = to.half_width - from.half_width, height = to.height - from.height;
            const double area =
                std::sqrt(width * width + height * height) * (from.half_width + to.half_width);
            profile_up_to_[i] = area + (i > 0 ? profile_up_to_[i - 1] : 0);
        }
        for (double& area : profile_up_to_) area /= profile_up_to_.back();

        Random random(seed, ~std::uint64_t{0});
        for (Hole& hole : holes_) {
            const double turn = kTurns - 0.1 - 1.2 * random.unit();
            hole.centre = shell(turn, 0.5 * random.unit() - 0.25, 1.0);
            hole.radius = 2.5 + 4.0 * random.unit();
        }
    }

    /// @param where  in [0, 1): the place on the way over all parts. Nothing when the scanner did
    /// not see the point.
    bool draw(double where, Random& random, Sample& sample) const {
        if (where < kShellShare) {
            sample.part = Part::Shell;
            draw_shell(where / kShellShare, random, sample);
            // Area across the tube: less on the inner side, whose circle is the smaller.
            const double area = 1.0 + kTubeRatio * cos_turns(sample.around);
            if (random.unit() * (1.0 + kTubeRatio) > area) return false;
        } else if ((where -= kShellShare) < kInnerWallShare) {
            sample.part = Part::InnerWall;
            const double depth = where / kInnerWallShare;
            sample.turn = kTurns - 0.30 * depth;
            sample.around = random.unit();
            sample.position = shell(sample.turn, sample.around, 1.0 - kWall);
            // The deeper inside, the less light comes back.
            if (random.unit() < depth * depth) return false;
        } else if ((where -= kInnerWallShare) < kPlinthShare) {
            sample.part = Part::Plinth;
            if (!draw_plinth(where / kPlinthShare, random, sample)) return false;
        } else {
            where = (where - kPlinthShare) / (1.0 - kShellShare - kInnerWallShare - kPlinthShare);
            const double around = random.unit();
            sample.part = Part::Rod;
            sample.position = rod(where, around);
            sample.normal = normal_at(rod, where, around, 1e-3, 1e-3);
        }
        if (!seen(sample, random)) return false;
        if (sample.part == Part::Shell || sample.part == Part::InnerWall) orient_shell(sample);
        return true;
    }

    Rgba8 color(const Sample& sample, double wear) const;

private:
    struct Hole {
        Vec3d centre;
        double radius = 0;
    };
    static constexpr std::size_t kSteps = 4096;

    static double turn_of(double step) { return kTurns * step / kSteps; }

    void draw_shell(double where, Random& random, Sample& sample) const {
        const auto above = std::upper_bound(area_up_to_.begin() + 1, area_up_to_.end() - 1, where);
        const auto step = static_cast<std::size_t>(above - area_up_to_.begin()) - 1;
        const double inside = (where - area_up_to_[step]) / (*above - area_up_to_[step]);
        sample.turn = turn_of(static_cast<double>(step) + inside);
        sample.around = random.unit();
        sample.position = shell(sample.turn, sample.around, 1.0);
    }

    static void orient_shell(Sample& sample) {
        const bool inner = sample.part == Part::InnerWall;
        const double width = inner ? 1.0 - kWall : 1.0;
        const auto surface = [&](double turn, double around) { return shell(turn, around, width); };
        const double step = inner ? -2e-4 : 2e-4;
        sample.normal = normal_at(surface, sample.turn, sample.around, step, 1e-3);
    }

    bool draw_plinth(double where, Random& random, Sample& sample) const {
        const auto found =
            std::upper_bound(profile_up_to_.begin(), profile_up_to_.end() - 1, where);
        const ProfileSegment& segment =
            kProfile[static_cast<std::size_t>(found - profile_up_to_.begin())];
        const double along = random.unit(), across = 2.0 * random.unit() - 1.0;
        const double half_width =
            segment.from.half_width + along * (segment.to.half_width - segment.from.half_width);
        const double widest = std::max(segment.from.half_width, segment.to.half_width);
        if (random.unit() * widest > half_width) return false;

        const bool front = random.unit() * (1.0 + kDepthOverWidth) < 1.0;
        const unsigned side = (front ? 0U : 1U) + (random.unit() < 0.5 ? 0U : 2U);
        const auto surface = [&](double u, double v) { return plinth(segment, side, u, v); };
        sample.position = surface(along, across);
        sample.normal = normal_at(surface, along, across, -1e-3, 1e-4);
        return true;
    }

    bool seen(const Sample& sample, Random& random) const {
        const Vec3d& p = sample.position;
        for (const Hole& hole : holes_) {
            const Vec3d away = p - hole.centre;
            const double distance_sq = away.dot(away);
            if (sample.part == Part::Shell && distance_sq < hole.radius * hole.radius) return false;
        }
        // Two sweeps: level lines 0.9 mm apart, and steeper ones that only a part of the surface
        // got.
        const double level = fraction(p.y() / 0.9);
        const double steep = fraction((0.8 * p.x() + 0.45 * p.y() + 0.4 * p.z()) / 1.3);
        const double on_line = std::max(1.0 - std::abs(4.0 * level - 2.0),
                                        p.x() > -20.0 ? 1.0 - std::abs(4.0 * steep - 2.0) : 0.0);
        return random.unit() < 0.35 + 0.65 * on_line;
    }

    std::uint64_t seed_;
    std::array<double, kSteps + 1> area_up_to_{};
    std::array<double, kProfile.size()> profile_up_to_{};
    std::array<Hole, 5> holes_{};
};

using Paint = Vec3d;  // sRGB, 0..255

Paint blend(const Paint& a, const Paint& b, double t) {
    return a + std::clamp(t, 0.0, 1.0) * (b - a);
}

Rgba8 quantised(const Paint& paint) {
    const auto channel = [](double v) {
        return static_cast<std::uint8_t>(std::clamp(std::floor(v + 0.5), 0.0, 255.0));
    };
    return {channel(paint.x()), channel(paint.y()), channel(paint.z()), 255};
}

/// Mother-of-pearl, as it shines on fossil ammonites: from copper over gold to green and blue.
Paint glaze(double t) {
    static const std::array<Paint, 5> kStops = {Paint(176, 74, 40), Paint(226, 160, 66),
                                                Paint(146, 176, 84), Paint(44, 148, 128),
                                                Paint(52, 96, 156)};
    const double at = std::clamp(t, 0.0, 1.0) * (kStops.size() - 1);
    const auto below = std::min<std::size_t>(static_cast<std::size_t>(at), kStops.size() - 2);
    return blend(kStops[below], kStops[below + 1], at - static_cast<double>(below));
}

Rgba8 Ammonite::color(const Sample& sample, double wear) const {
    const Vec3d& p = sample.position;
    switch (sample.part) {
        case Part::Shell: {
            const double hue = 1.5 * lattice_noise(p / 34.0, seed_) - 0.25 +
                               0.22 * (lattice_noise(p / 7.0, seed_ + 1) - 0.5);
            const double bare = 1.6 * lattice_noise(p / 15.0, seed_ + 2) - 0.55;
            Paint paint = blend(glaze(hue), Paint(222, 202, 168), bare);
            paint = blend(paint, Paint(250, 240, 214), 0.35 * rib(sample.turn, sample.around));
            // Dirt sits where the whorls meet, as light never does.
            const double open = smooth(0.5 + 0.5 * cos_turns(sample.around));
            return quantised(paint * (0.52 + 0.48 * open) * (0.94 + 0.12 * wear));
        }
        case Part::InnerWall: {
            const double depth = (kTurns - sample.turn) / 0.30;
            const Paint paint = blend(Paint(238, 222, 200), Paint(96, 62, 48), depth);
            return quantised(paint * (0.95 + 0.1 * wear));
        }
        case Part::Plinth: {
            const double drift =
                1.3 * lattice_noise(p / 40.0, seed_ + 3) + 0.25 * lattice_noise(p / 9.0, seed_ + 5);
            const double wave =
                std::abs(sin_turns(p.x() / 70.0 + p.y() / 55.0 + p.z() / 90.0 + drift));
            const double vein = std::max(0.0, 1.0 - 9.0 * wave);
            const double cloud = lattice_noise(p / 6.0, seed_ + 4);
            const Paint stone = blend(Paint(52, 58, 70), Paint(84, 90, 102), cloud);
            return quantised(blend(stone, Paint(214, 210, 200), 0.75 * vein) *
                             (0.96 + 0.08 * wear));
        }
        case Part::Rod:
            break;
    }
    return quantised(Paint(196, 154, 74) * (0.9 + 0.2 * wear));
}

/// What comes back of the scanner's light: more from bright and facing surfaces.
float intensity(const Rgba8& color, const Vec3d& normal, Random& random) {
    const double bright = (0.3 * color.r + 0.59 * color.g + 0.11 * color.b) / 255.0;
    const double facing = std::abs(0.36 * normal.x() + 0.48 * normal.y() + 0.8 * normal.z());
    const double value = bright * (0.35 + 0.65 * facing) + 0.02 * random.bell();
    return static_cast<float>(std::clamp(value, 0.0, 1.0));
}

/// The place of point i on the way, until the scanner sees one there; elsewhere when it sees none.
Sample seen_sample(const Ammonite& ammonite, std::uint64_t i, std::uint64_t n, Random& random) {
    constexpr int kTriesInPlace = 24;
    Sample sample;
    for (int tries = 0;; ++tries) {
        const double where = tries < kTriesInPlace
                                 ? (static_cast<double>(i) + random.unit()) / static_cast<double>(n)
                                 : random.unit();
        if (ammonite.draw(std::min(where, 1.0 - 0x1p-53), random, sample)) return sample;
    }
}

}  // namespace

void validate(const SyntheticScanOptions& options) {
    require(options.points >= 1 && options.points <= 0xffffffffULL, "points", options.points,
            "1..4294967295");
    require(options.noise >= 0 && options.noise <= 10, "noise", options.noise, "0..10 mm");
}

PointCloud synthetic_scan(const SyntheticScanOptions& options, const RunContext& context) {
    validate(options);
    const std::size_t n = options.points;
    const Ammonite ammonite(options.seed);

    PointCloud cloud;
    cloud.positions.resize(n);
    cloud.normals.resize(n);
    cloud.colors.resize(n);
    std::vector<float> intensities(n);

    constexpr std::size_t kBlock = 4096, kBatch = 32 * kBlock;
    for (std::size_t begin = 0; begin < n; begin += kBatch) {
        context.checkpoint(static_cast<double>(begin) / static_cast<double>(n));
        const std::size_t count = std::min(kBatch, n - begin);
        parallel_for_blocks(count, kBlock, context, [&](std::size_t from, std::size_t to) {
            for (std::size_t i = begin + from; i < begin + to; ++i) {
                Random random(options.seed, i);
                const Sample sample = seen_sample(ammonite, i, n, random);
                const Vec3d moved = sample.position + options.noise * random.bell() * sample.normal;
                cloud.positions[i] = moved.cast<float>();
                cloud.normals[i] = sample.normal.cast<float>();
                cloud.colors[i] = ammonite.color(sample, random.unit());
                intensities[i] = intensity(cloud.colors[i], sample.normal, random);
            }
        });
    }
    cloud.attributes.push_back({"intensity", std::move(intensities), 1, Reduction::Mean});
    context.checkpoint(1.0);
    return cloud;
}

}  // namespace stipple
