#include "contraction.hpp"

#include "hilbert_order.hpp"
#include "parallel_for.hpp"
#include "stipple/neighbors.hpp"
#include "symmetric_eigen.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>

namespace stipple {

namespace {

constexpr Index kNone = std::numeric_limits<Index>::max();
constexpr std::size_t kBlock = 1024;
constexpr unsigned kMaxNeighbors = 32;
constexpr float kUnknown = -1;
constexpr float kIsolated = std::numeric_limits<float>::infinity();

/// All that a contraction reads of a sample, in one line of the cache.
struct alignas(64) Record {
    Vec3f position;
    StoredQuadric quadric;
    Index link;    ///< itself; of one that was contracted away, the sample that it became
    Index merged;  ///< the sample contracted into this one in the last round, or kNone
    float cost;    ///< of the contraction with `neighbors[0]`
};
static_assert(sizeof(Record) == 64);

/// A number for a pair that looks like chance, to choose among pairs of the same cost.
std::uint32_t shuffled(Index a, Index b) noexcept {
    std::uint64_t h = (static_cast<std::uint64_t>(std::min(a, b)) << 32U | std::max(a, b)) *
                      0x9E3779B97F4A7C15ULL;
    h ^= h >> 29U;
    h *= 0xBF58476D1CE4E5B9ULL;
    return static_cast<std::uint32_t>(h >> 32U);
}

struct Contracted {
    Vec3d offset;  ///< of the new position, from the first sample's
    double cost;
};

class Engine {
public:
    Engine(std::span<const Vec3f> positions, std::span<const StoredQuadric> quadrics,
           const ContractionOptions& options, const RunContext& context)
        : options_(options), context_(context), k_(options.k) {
        order_ = hilbert_order(positions, context);
        const std::size_t n = positions.size();
        std::vector<Vec3f> sorted(n);
        for (std::size_t i = 0; i < n; ++i) sorted[i] = positions[order_[i]];
        NeighborLists lists =
            k_nearest_neighbors(sorted, unsigned(std::max(k_, std::size_t(16))), context);
        neighbors_.assign(n * k_, kNone);
        for (std::size_t i = 0; i < n; ++i) {
            const auto of = lists.of(i);
            std::copy_n(of.begin(), std::min<std::size_t>(of.size(), k_), &neighbors_[i * k_]);
        }
        records_.resize(n);
        for (std::size_t i = 0; i < n; ++i) {
            records_[i].position = sorted[i];
            records_[i].link = static_cast<Index>(i);
            records_[i].merged = kNone;
            records_[i].cost = kUnknown;
        }
        if (quadrics.empty())
            make_quadrics(lists);
        else
            for (std::size_t i = 0; i < n; ++i) records_[i].quadric = quadrics[order_[i]];
        claims_.resize(n);
        live_.resize(n);
        for (std::size_t i = 0; i < n; ++i) live_[i] = static_cast<Index>(i);
    }

    std::size_t size() const { return live_.size(); }
    std::size_t rounds = 0, evals = 0;

    /// One round; contracts down to each of the counts on the way.
    template <typename At>
    void round(std::span<const std::uint64_t>& counts, At&& at_count) {
        ++rounds;
        refresh();
        propose(threshold());
        std::vector<Winner> winners = match();
        if (winners.empty()) {
            reconnect();
            return;
        }
        std::ranges::sort(winners);
        std::size_t done = 0;
        while (true) {
            std::size_t end = winners.size();
            const bool stop = !counts.empty() && size() - end <= counts.front();
            if (stop) end = size() - counts.front();
            for (; done < end; ++done) contract(winners[done]);
            if (!stop) break;
            at_count();
            counts = counts.subspan(1);
            if (counts.empty()) break;
        }
        std::erase_if(live_, [&](Index i) { return records_[i].link != i; });
    }

    ContractionSnapshot snapshot() {
        ContractionSnapshot s;
        s.survivor_of.resize(records_.size());
        for (const Index i : live_) {
            if (records_[i].link != i) continue;
            claims_[i] = static_cast<Index>(s.positions.size());
            s.positions.push_back(records_[i].position);
            s.samples.push_back(order_[i]);
        }
        for (std::size_t i = 0; i < records_.size(); ++i)
            s.survivor_of[order_[i]] = claims_[root(static_cast<Index>(i))];
        return s;
    }

private:
    struct Winner {
        float cost;
        Index kept, gone;
        auto operator<=>(const Winner&) const = default;
    };

    Index root(Index i) const {
        while (records_[i].link != i) i = records_[i].link;
        return i;
    }

    void make_quadrics(const NeighborLists& lists) {
        const std::size_t n = records_.size();
        const double lambda = kPointTerm;
        const double area_power = 1.0;
        const double bound = 0;
        std::vector<Vec3f> normals(n);
        std::vector<float> areas(n);
        double sum = 0;
        const unsigned kn = unsigned(16);
        for (std::size_t i = 0; i < n; ++i) {
            Symmetric3 m;
            Vec3d mean = Vec3d::Zero();
            std::array<Vec3d, 64> e;
            std::size_t count = 0;
            const Vec3f p = records_[i].position;
            for (const Index j : lists.of(i)) {
                if (count == kn) break;
                e[count] = (records_[j].position - p).cast<double>();
                mean += e[count++];
            }
            areas[i] = float(e[count - 1].squaredNorm() / double(count));
            sum += double(areas[i]);
            mean /= double(count + 1);
            e[count++] = Vec3d::Zero();
            for (std::size_t a = 0; a < count; ++a) {
                const Vec3d d = e[a] - mean;
                m.xx += d.x() * d.x();
                m.xy += d.x() * d.y();
                m.xz += d.x() * d.z();
                m.yy += d.y() * d.y();
                m.yz += d.y() * d.z();
                m.zz += d.z() * d.z();
            }
            normals[i] = eigenvector(m, eigenvalues(m)[0]).cast<float>();
        }
        sum /= double(n);
        const int planes = int(0);
        for (std::size_t i = 0; i < n; ++i) {
            Quadric q;
            const double w = std::pow(double(areas[i]) / sum, area_power);
            const Vec3f p = records_[i].position;
            const Vec3d normal = normals[i].cast<double>();
            const std::size_t k = std::min<std::size_t>(lists.of(i).size(), k_);
            if (planes == 0) {
                for (const Index j : lists.of(i).first(k)) {
                    const Vec3d e = (records_[j].position - p).cast<double>();
                    const Vec3d m = e.cross(e.cross(normal));
                    const double length = m.norm();
                    if (length > 0) add_plane(q, m / length, Vec3d::Zero(), w / double(k));
                }
            } else {
                add_plane(q, normal, Vec3d::Zero(), w);
            }
            if (bound > 0) {
                Vec3d o = Vec3d::Zero();
                for (const Index j : lists.of(i)) o += (records_[j].position - p).cast<double>();
                o /= double(lists.of(i).size());
                o -= normal * normal.dot(o);
                const double r = std::sqrt(double(lists.distances_sq[lists.offsets[i + 1] - 1]));
                const double one_sided = std::clamp((o.norm() / r - 0.28) / 0.12, 0.0, 1.0);
                if (one_sided > 0)
                    add_plane(q, o.normalized(), Vec3d::Zero(), bound * w * one_sided);
            }
            add_point(q, Vec3d::Zero(), w * lambda);
            records_[i].quadric = StoredQuadric(q);
        }
    }

    Contracted evaluate(Index first, Index second) const {
        const Record &a = records_[first], &b = records_[second];
        const Vec3d d = (b.position - a.position).cast<double>();
        const Quadric sum = Quadric(a.quadric) + referred_to(Quadric(b.quadric), -d);
        Vec3d y;
        if (options_.placement == Placement::EndPoint) {
            const double at_a = sum.c, at_b = value(sum, d);
            return at_b < at_a ? Contracted{d, at_b} : Contracted{Vec3d::Zero(), at_a};
        }
        if (!minimiser(sum, y)) y = 0.5 * d;
        const double limit = d.squaredNorm();
        const Vec3d from_mid = y - 0.5 * d;
        const double away = from_mid.squaredNorm();
        if (away > limit) y = 0.5 * d + from_mid * std::sqrt(limit / away);
        return {y, std::max(0.0, value(sum, y))};
    }

    float cost_of(Index i, Index j) const {
        static const double guard = 0;
        const auto [a, b] = std::minmax(i, j);
        double cost = evaluate(a, b).cost;
        static const int mode = int(2);
        static const double power = 1;
        const auto weight = [](const StoredQuadric& q) { return double(q.xx + q.yy + q.zz); };
        if (mode == 1)
            cost =
                std::max(0.0, cost - double(records_[i].quadric.c) - double(records_[j].quadric.c));
        else if (mode == 2)
            cost *= std::pow(weight(records_[i].quadric) + weight(records_[j].quadric), power);
        else if (mode == 3) {
            const double wi = weight(records_[i].quadric), wj = weight(records_[j].quadric);
            cost = std::max(0.0, std::sqrt(cost * (wi + wj)) -
                                     std::sqrt(std::max(0.f, records_[i].quadric.c) * wi) -
                                     std::sqrt(std::max(0.f, records_[j].quadric.c) * wj));
        }
        if (guard > 0) {
            const double d = double((records_[i].position - records_[j].position).squaredNorm());
            cost += guard * d * d;
        }
        return static_cast<float>(cost);
    }

    bool better(float cost, Index i, Index j, float than, Index a, Index b) const {
        return cost < than || (cost == than && shuffled(i, j) < shuffled(a, b));
    }

    void refresh() {
        parallel_for_blocks(live_.size(), kBlock, context_,
                            [&](std::size_t begin, std::size_t end) {
                                for (std::size_t l = begin; l < end; ++l) refresh(live_[l]);
                            });
    }

    void refresh(Index i) {
        Record& self = records_[i];
        claims_[i] = kNone;
        std::array<std::pair<float, Index>, 2 * kMaxNeighbors> found;
        std::size_t count = 0;
        bool changed = self.merged != kNone || self.cost == kUnknown;
        const Index old_partner = neighbors_[std::size_t(i) * k_];
        const auto take = [&](Index of) {
            for (unsigned s = 0; s < k_; ++s) {
                Index j = neighbors_[std::size_t(of) * k_ + s];
                if (j == kNone) break;
                const Index r = root(j);
                if (r != j || records_[r].merged != kNone) changed = true;
                if (r == i) continue;
                bool known = false;
                for (std::size_t f = 0; f < count; ++f) known |= found[f].second == r;
                if (known) continue;
                found[count++] = {(records_[r].position - self.position).squaredNorm(), r};
            }
        };
        take(i);
        if (self.merged != kNone) take(self.merged);
        if (!changed) return;
        (void)old_partner;
        if (count > k_) {
            std::nth_element(found.begin(), found.begin() + k_,
                             found.begin() + std::ptrdiff_t(count));
            count = k_;
        }
        Index* const list = &neighbors_[std::size_t(i) * k_];
        self.cost = kIsolated;
        std::size_t best = 0;
        for (std::size_t f = 0; f < count; ++f) {
            const Index j = found[f].second;
            list[f] = j;
            const float cost = cost_of(i, j);
            if (f == 0 || better(cost, i, j, self.cost, i, list[best])) {
                best = f;
                self.cost = cost;
            }
        }
        std::fill(list + count, list + k_, kNone);
        if (count > 0) std::swap(list[0], list[best]);
    }

    float threshold() const {
        static const double quantile = 0.3;
        constexpr std::size_t kSample = 1 << 16;
        const std::size_t step = std::max<std::size_t>(1, live_.size() / kSample);
        std::vector<float> costs;
        for (std::size_t l = 0; l < live_.size(); l += step)
            costs.push_back(records_[live_[l]].cost);
        const auto at = costs.begin() + std::ptrdiff_t(quantile * double(costs.size()));
        std::nth_element(costs.begin(), at, costs.end());
        return *at;
    }

    void propose(float limit) {
        parallel_for_blocks(
            live_.size(), kBlock, context_, [&](std::size_t begin, std::size_t end) {
                for (std::size_t l = begin; l < end; ++l) {
                    const Index i = live_[l];
                    records_[i].merged = kNone;
                    const float cost = records_[i].cost;
                    if (!(cost <= limit) || cost == kIsolated) continue;
                    const Index j = neighbors_[std::size_t(i) * k_];
                    std::atomic_ref<Index> claim(claims_[j]);
                    Index held = claim.load(std::memory_order_relaxed);
                    while (held == kNone || better(cost, i, j, records_[held].cost, held, j))
                        if (claim.compare_exchange_weak(held, i, std::memory_order_relaxed)) break;
                }
            });
        limit_ = limit;
    }

    std::vector<Winner> match() {
        std::vector<Winner> winners;
        for (const Index i : live_) {
            const float cost = records_[i].cost;
            if (!(cost <= limit_) || cost == kIsolated) continue;
            const Index j = neighbors_[std::size_t(i) * k_];
            if (claims_[j] != i) continue;
            const Index back = neighbors_[std::size_t(j) * k_];
            if (back == i) {
                // Both chose each other; costs are the same bits.
                if (i > j) continue;
            } else if (back != kNone && better(records_[j].cost, j, back, cost, i, j)) {
                continue;
            }
            const Index other = claims_[i];
            if (other != kNone && other != j && better(records_[other].cost, other, i, cost, i, j))
                continue;
            winners.push_back({cost, std::min(i, j), std::max(i, j)});
        }
        return winners;
    }

    void contract(const Winner& w) {
        Record &a = records_[w.kept], &b = records_[w.gone];
        const Vec3d d = (b.position - a.position).cast<double>();
        const Contracted to = evaluate(w.kept, w.gone);
        const Quadric sum = Quadric(a.quadric) + referred_to(Quadric(b.quadric), -d);
        const bool at_b = options_.placement == Placement::EndPoint && to.offset == d;
        Record &kept = at_b ? b : a, &gone = at_b ? a : b;
        const Vec3f position =
            at_b ? b.position : Vec3f((a.position.cast<double>() + to.offset).cast<float>());
        kept.quadric =
            StoredQuadric(referred_to(sum, (position.cast<double>() - a.position.cast<double>())));
        kept.position = position;
        const Index k = at_b ? w.gone : w.kept, g = at_b ? w.kept : w.gone;
        gone.link = k;
        kept.merged = g;
        kept.cost = kUnknown;
    }

    void reconnect() {
        std::vector<Vec3f> positions;
        for (const Index i : live_) positions.push_back(records_[i].position);
        const NeighborLists lists = k_nearest_neighbors(positions, k_, context_);
        for (std::size_t l = 0; l < live_.size(); ++l) {
            Index* const list = &neighbors_[std::size_t(live_[l]) * k_];
            std::fill_n(list, k_, kNone);
            std::size_t f = 0;
            for (const Index j : lists.of(l)) list[f++] = live_[j];
            records_[live_[l]].cost = kUnknown;
        }
    }

    ContractionOptions options_;
    const RunContext& context_;
    std::size_t k_;
    std::vector<Index> order_;
    std::vector<Record> records_;
    std::vector<Index> neighbors_;
    std::vector<Index> claims_;
    std::vector<Index> live_;
    float limit_ = 0;
};

}  // namespace

void contract(std::span<const Vec3f> positions, std::span<const StoredQuadric> quadrics,
              std::span<const std::uint64_t> counts, const ContractionOptions& options,
              const std::function<void(ContractionSnapshot&&)>& on_snapshot,
              const RunContext& context) {
    Engine engine(positions, quadrics, options, context);
    while (!counts.empty() && counts.front() >= engine.size()) {
        on_snapshot(engine.snapshot());
        counts = counts.subspan(1);
    }
    while (!counts.empty()) engine.round(counts, [&] { on_snapshot(engine.snapshot()); });
}

}  // namespace stipple
