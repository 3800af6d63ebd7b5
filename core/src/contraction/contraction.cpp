#include "contraction/contraction.hpp"

#include "base/first_touch.hpp"
#include "base/large_memory.hpp"
#include "base/parallel_for.hpp"
#include "base/progress_for.hpp"
#include "base/until_stopped.hpp"
#include "contraction/contraction_graph.hpp"
#include "contraction/contraction_quadrics.hpp"
#include "contraction/contraction_record.hpp"
#include "neighbors/nearest_lists.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <new>
#include <string>
#include <tuple>

// Follows: Pauly, Gross, Kobbelt 2002, §3.2; Garland and Heckbert 1997.
//
// The paper contracts one pair after the other from a queue. Here every sample keeps its cheapest
// partner, and in a round all pairs below a quantile of the costs contract that are cheapest at
// both of their ends, in parallel. Which pairs these are does not depend on the number of threads,
// nor on how far the contraction goes: a round that would go too far contracts its cheapest first.
// Where costs grow along a whole curve, only the pair at its end is cheapest at both of its ends.
// So a round with few of those takes costs that are nearly the same for the same.

namespace stipple {

namespace {

constexpr Index kNone = ContractionGraph::kNone;
constexpr std::size_t kBlock = 1024, kFilled = 1 << 17;
constexpr unsigned kMaxNeighbors = 32;
constexpr double kProgressToGraph = 0.35, kProgressToRounds = 0.45;
constexpr std::size_t kRoundsToHalve = 64;  // about as many as are bearable
constexpr float kUnknown = -1;              // a cost that has to be computed
constexpr float kIsolated = std::numeric_limits<float>::infinity();

using Record = ContractionRecord;

/// The bit of `ContractionRecord::link` that says that another was just contracted into the sample.
constexpr Index kMerged = Index{1} << 31U;

/// A number for a pair that looks like chance, to choose among pairs of the same cost. No two pairs
/// have the same.
std::uint64_t shuffled(Index a, Index b) noexcept {
    std::uint64_t h = static_cast<std::uint64_t>(std::min(a, b)) << 32U | std::max(a, b);
    h *= 0x9E3779B97F4A7C15ULL;
    h ^= h >> 29U;
    return h * 0xBF58476D1CE4E5B9ULL;
}

/// How costs are compared where pairs are matched.
enum class CompareCosts { Exactly, Coarsely };

/// Coarsely, costs are the same that differ by less than a quarter at most.
float compared(float cost, CompareCosts how) noexcept {
    constexpr std::uint32_t kCompared = 0xFFE00000;  // sign, exponent and two bits of a float
    return how == CompareCosts::Exactly
               ? cost
               : std::bit_cast<float>(std::bit_cast<std::uint32_t>(cost) & kCompared);
}

class Contraction {
public:
    Contraction(std::span<const Vec3f> positions, std::span<const StoredQuadric> quadrics,
                const ContractionOptions& options, const RunContext& context);

    void run(std::span<const std::uint64_t> counts,
             const std::function<void(ContractionSnapshot&&)>& on_snapshot);

private:
    Record* records() const { return static_cast<Record*>(memory_.data()); }
    Index* list_of(Index i) { return &neighbors_[static_cast<std::size_t>(i) * k_]; }
    const Index* list_of(Index i) const { return &neighbors_[static_cast<std::size_t>(i) * k_]; }

    bool is_live(Index i) const {
        return records()[i].link == i || (records()[i].link & kMerged) != 0;
    }
    /// The live sample that i has become.
    Index root(Index i) const {
        while (!is_live(i)) i = records()[i].link;
        return i;
    }

    bool is_changed(Index i) const { return (changed_[i / 64] >> (i % 64) & 1U) != 0; }
    void set_changed(Index i) {
        std::atomic_ref<std::uint64_t>(changed_[i / 64])
            .fetch_or(std::uint64_t{1} << (i % 64), std::memory_order_relaxed);
    }

    template <typename Visit>
    void for_neighbors(Index of, Visit&& visit) const;
    void fill_records(std::size_t from, std::size_t to, std::span<const Vec3f> positions,
                      std::span<const StoredQuadric> quadrics,
                      std::span<const std::uint32_t> tangents);
    void make_quadrics();
    std::vector<float> feature_steps(Index i) const;
    Index place(Index slot) const { return place_of_.empty() ? slot : place_of_[slot]; }
    Index slot_at(std::size_t place) const {
        return slot_of_.empty() ? static_cast<Index>(place) : slot_of_[place];
    }
    bool is_better(float cost, Index i, Index j, float than, Index a, Index b) const {
        return cost < than || (cost == than && shuffled(i, j) < shuffled(a, b));
    }

    void round(std::span<const std::uint64_t>& counts, const std::function<void()>& at_count);
    struct Gathered;
    void gather(Index of, Index self, Gathered& gathered) const;
    void refresh(Index i);
    void keep_nearest(Index i, Gathered& found) const;
    void choose_partner(Index i, std::span<const Index> asked);
    void compact();
    float quantile_of_costs() const;
    void propose(float limit, CompareCosts how);
    bool wins(Index i, float limit, CompareCosts how) const;
    std::vector<Index> match(float limit, CompareCosts how);
    void contract(Index winner);
    void contract(std::span<const Index> winners);
    void reconnect();

    ContractionSnapshot snapshot() const;

    template <typename Body>
    void for_live(Body&& body) {
        parallel_for_blocks(slots_, kBlock, context_, [&](std::size_t begin, std::size_t end) {
            for (auto i = static_cast<Index>(begin); i < end; ++i)
                if (is_live(i)) body(i);
        });
    }

    /// Calls body(i) for every slot in order.
    template <typename Body>
    void for_slots(Body&& body) const {
        for_blocks_in_order(slots_, context_, [&](std::size_t begin, std::size_t end) {
            for (auto i = static_cast<Index>(begin); i < end; ++i) body(i);
        });
    }

    /// Calls body(i) for i = 0..N-1, with N the number of samples.
    template <typename Body>
    void for_places(Body&& body) const {
        parallel_for_blocks(order_.size(), kBlock, context_,
                            [&](std::size_t begin, std::size_t end) {
                                for (std::size_t i = begin; i < end; ++i) body(i);
                            });
    }

    const ContractionOptions& options_;
    const RunContext& context_;
    std::size_t k_;
    double scale_;
    std::vector<Index> order_;      ///< the samples along a curve; slots are places on it at first
    std::vector<Index> slot_of_;    ///< by place on the curve, since slots were last renumbered
    std::vector<Index> place_of_;   ///< by slot, since then; before, slots are places
    LargeMemory memory_;            ///< the records, by slot
    std::size_t slots_;             ///< in use
    std::vector<Index> neighbors_;  ///< k for each slot, the partner first; kNone ends a list
    std::size_t live_;              ///< slots with a live sample
    std::vector<std::uint64_t> changed_;  ///< a bit for each slot: part of a contraction since the
                                          ///< lists were brought up to date
};

Contraction::Contraction(std::span<const Vec3f> positions, std::span<const StoredQuadric> quadrics,
                         const ContractionOptions& options, const RunContext& context)
    : options_(options),
      context_(context),
      k_(options.k),
      scale_(contraction_scale(positions, context)),
      memory_(positions.size() * sizeof(Record)),
      slots_(positions.size()),
      live_(positions.size()),
      changed_(positions.size() / 64 + 1) {
    const auto scale = static_cast<float>(scale_);
    std::vector<std::uint32_t> tangents;
    {
        auto scaled = made_in_blocks<std::vector<Vec3f>>(slots_, context);
        parallel_for_blocks(slots_, kBlock, context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) scaled[i] = positions[i] * scale;
        });
        ContractionGraph graph = contraction_graph(scaled, options.k, quadrics.empty(),
                                                   context.part(0, kProgressToGraph));
        order_ = std::move(graph.order);
        neighbors_ = std::move(graph.neighbors);
        tangents = std::move(graph.tangents);
    }
    return_freed_memory();
    // From the end, so that tangents can go as the records come, which keep them as claims.
    for (std::size_t end = slots_; end > 0;) {
        const std::size_t begin = (end - 1) / kFilled * kFilled;
        fill_records(begin, end, positions, quadrics, tangents);
        if (!tangents.empty()) cut_off(tangents, begin);
        end = begin;
    }
    if (quadrics.empty()) make_quadrics();
}

void Contraction::fill_records(std::size_t from, std::size_t to, std::span<const Vec3f> positions,
                               std::span<const StoredQuadric> quadrics,
                               std::span<const std::uint32_t> tangents) {
    const auto scale = static_cast<float>(scale_);
    parallel_for_blocks(to - from, kBlock, context_, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = from + begin; i < from + end; ++i) {
            const Index sample = order_[i];
            new (&records()[i])
                Record{.position = positions[sample] * scale,
                       .quadric = quadrics.empty() ? StoredQuadric{} : quadrics[sample],
                       .link = static_cast<Index>(i),
                       .claim = tangents.empty() ? kNone : tangents[i],
                       .cost = kUnknown};
        }
    });
}

/// Calls visit(neighbour) for the list of a slot.
template <typename Visit>
void Contraction::for_neighbors(Index of, Visit&& visit) const {
    const Index* const list = list_of(of);
    for (std::size_t s = 0; s < k_ && list[s] != kNone; ++s) visit(list[s]);
}

/// The quadrics of §3.2. A sample stands for an area that goes as the mean squared distance of its
/// neighbours; the sum over all samples does not depend on their number.
void Contraction::make_quadrics() {
    const auto make = [&](std::size_t begin, std::size_t end) {
        std::vector<Vec3d> neighbors;
        for (auto i = static_cast<Index>(begin); i < end; ++i) {
            neighbors.clear();
            double area = 0;  // within a factor, that of the surface for which the sample stands
            for_neighbors(i, [&](Index j) {
                neighbors.push_back((records()[j].position - records()[i].position).cast<double>());
                area += neighbors.back().squaredNorm();
            });
            if (neighbors.empty()) continue;
            area *= static_cast<double>(slots_) / static_cast<double>(neighbors.size());
            const Tangent tangent = unpacked(records()[i].claim);
            Quadric q;
            add_edges(q, neighbors, tangent, area);
            if (options_.channels > 0) {
                add_gradients(q, neighbors, feature_steps(i), options_.channels, tangent.normal,
                              area);
            }
            records()[i].quadric = StoredQuadric(q);
        }
    };
    parallel_for_blocks_in_parts(slots_, kBlock, context_.part(kProgressToGraph, kProgressToRounds),
                                 make);
}

/// The features of each neighbour less the sample's own.
std::vector<float> Contraction::feature_steps(Index i) const {
    const auto features = [&](Index slot) {
        return options_.features.subspan(static_cast<std::size_t>(order_[slot]) * options_.channels,
                                         options_.channels);
    };
    std::vector<float> steps;
    for_neighbors(i, [&](Index j) {
        for (unsigned c = 0; c < options_.channels; ++c)
            steps.push_back((features(j)[c] - features(i)[c]) * static_cast<float>(scale_));
    });
    return steps;
}

/// The neighbours of a sample in a round: each live and named once.
struct Contraction::Gathered {
    std::array<Index, 2 * kMaxNeighbors> slots;
    std::array<bool, 2 * kMaxNeighbors> changed;  ///< whether it was part of a contraction
    std::size_t count = 0;

    void add(Index slot, bool is_changed) {
        for (std::size_t f = 0; f < count; ++f)
            if (slots[f] == slot) return;
        slots[count] = slot;
        changed[count++] = is_changed;
    }
};

void Contraction::gather(Index of, Index self, Gathered& gathered) const {
    for_neighbors(of, [&](Index named) {
        const bool changed = is_changed(named);
        const Index j = changed ? root(named) : named;
        if (j != self) gathered.add(j, changed);
    });
}

/// Brings the list of neighbours up to date, and chooses the partner.
void Contraction::refresh(Index i) {
    Record& self = records()[i];
    self.claim = kNone;
    if (self.cost != kUnknown) {
        bool any_changed = false;
        for_neighbors(i, [&](Index j) { any_changed |= is_changed(j); });
        if (!any_changed) return;
    }
    Gathered found;
    const Index partner = list_of(i)[0];
    gather(i, i, found);
    const bool merged = (self.link & kMerged) != 0;
    if (merged) gather(self.link & ~kMerged, i, found);
    if (found.count > k_) keep_nearest(i, found);

    Index* const list = list_of(i);
    std::copy_n(found.slots.begin(), found.count, list);
    std::fill(list + found.count, list + k_, kNone);
    // Where the partner is as it was, only what changed can be cheaper.
    const bool has_partner = !merged && self.cost != kUnknown && found.count > 0 &&
                             list[0] == partner && !found.changed[0];
    std::size_t asking = has_partner ? 0 : found.count;
    if (has_partner) {
        for (std::size_t f = 1; f < found.count; ++f)
            if (found.changed[f]) found.slots[asking++] = found.slots[f];
    } else {
        self.cost = kIsolated;
    }
    choose_partner(i, std::span(found.slots).first(asking));
}

/// The nearest to sample i, as many as a list holds.
void Contraction::keep_nearest(Index i, Gathered& found) const {
    std::array<std::pair<float, Index>, 2 * kMaxNeighbors> by_distance;
    for (std::size_t f = 0; f < found.count; ++f) {
        const Vec3f d = records()[found.slots[f]].position - records()[i].position;
        by_distance[f] = {d.squaredNorm(), found.slots[f]};
    }
    const auto end = by_distance.begin() + static_cast<std::ptrdiff_t>(found.count);
    std::nth_element(by_distance.begin(), by_distance.begin() + static_cast<std::ptrdiff_t>(k_) - 1,
                     end);
    found.count = k_;
    for (std::size_t f = 0; f < k_; ++f) found.slots[f] = by_distance[f].second;
}

/// Puts the cheapest of the asked, if it is cheaper than the partner of before, to the front of the
/// list.
void Contraction::choose_partner(Index i, std::span<const Index> asked) {
    Index* const list = list_of(i);
    Index best = list[0];
    float least = records()[i].cost;
    for (std::size_t f = 0; f < asked.size(); f += 4) {
        const std::size_t lanes = std::min<std::size_t>(4, asked.size() - f);
        std::array<const Record*, 4> firsts, seconds;
        for (std::size_t lane = 0; lane < 4; ++lane) {
            // In the order of their numbers, so that both ends of a pair find the same bits.
            const Index j = asked[f + std::min(lane, lanes - 1)];
            firsts[lane] = &records()[std::min(i, j)];
            seconds[lane] = &records()[std::max(i, j)];
        }
        const Float4 costs = costs_of_joining(firsts, seconds, options_.placement);
        for (std::size_t lane = 0; lane < lanes; ++lane) {
            const Index j = asked[f + lane];
            if (is_better(costs[lane], i, j, least, i, best)) {
                best = j;
                least = costs[lane];
            }
        }
    }
    records()[i].cost = least;
    if (best != list[0]) std::swap(list[0], *std::find(list, list + k_, best));
}

float Contraction::quantile_of_costs() const {
    constexpr double kQuantile = 0.5;
    constexpr std::size_t kAsked = 1 << 13;
    const std::size_t step = std::max<std::size_t>(1, live_ / kAsked);
    std::vector<float> costs;
    for (std::size_t i = 0; i < slots_; i += step)
        if (is_live(static_cast<Index>(i))) costs.push_back(records()[i].cost);
    if (costs.empty()) return kIsolated;
    const auto at =
        costs.begin() + static_cast<std::ptrdiff_t>(kQuantile * static_cast<double>(costs.size()));
    std::ranges::nth_element(costs, at);
    return *at;
}

/// Every sample whose contraction costs at most `limit` asks its partner for it.
void Contraction::propose(float limit, CompareCosts how) {
    const auto cost_of = [&](Index i) { return compared(records()[i].cost, how); };
    for_live([&](Index i) {
        Record& self = records()[i];
        self.link = i;
        if (!(self.cost <= limit) || self.cost == kIsolated) return;
        const Index partner = list_of(i)[0];
        std::atomic_ref<Index> claim(records()[partner].claim);
        Index held = claim.load(std::memory_order_relaxed);
        while (held == kNone || is_better(cost_of(i), i, partner, cost_of(held), held, partner)) {
            if (claim.compare_exchange_weak(held, i, std::memory_order_relaxed)) break;
        }
    });
}

/// Whether the contraction of i with its partner is the cheapest that either of them is part of.
bool Contraction::wins(Index i, float limit, CompareCosts how) const {
    const auto cost_of = [&](Index of) { return compared(records()[of].cost, how); };
    if (!(records()[i].cost <= limit) || records()[i].cost == kIsolated) return false;
    const float cost = cost_of(i);
    const Index partner = list_of(i)[0];
    const Record& other = records()[partner];
    if (other.claim != i) return false;
    const Index asked = list_of(partner)[0];
    if (asked == i) {
        if (i > partner) return false;  // both asked: counted once
    } else if (asked != kNone && is_better(cost_of(partner), partner, asked, cost, i, partner)) {
        return false;
    }
    const Index claim = records()[i].claim;
    return claim == kNone || claim == partner ||
           !is_better(cost_of(claim), claim, i, cost, i, partner);
}

/// One sample of each pair that contracts now, with its partner.
std::vector<Index> Contraction::match(float limit, CompareCosts how) {
    propose(limit, how);
    std::vector<std::vector<Index>> parts((slots_ + kBlock - 1) / kBlock);
    parallel_for_blocks(slots_, kBlock, context_, [&](std::size_t begin, std::size_t end) {
        std::vector<Index>& part = parts[begin / kBlock];
        for (auto i = static_cast<Index>(begin); i < end; ++i)
            if (is_live(i) && wins(i, limit, how)) part.push_back(i);
    });
    std::size_t count = 0;
    for (const auto& part : parts) count += part.size();
    std::vector<Index> winners;
    winners.reserve(count);
    for (auto& part : parts) {
        context_.throw_if_stopped();
        winners.insert(winners.end(), part.begin(), part.end());
        std::vector<Index>().swap(part);
    }
    return winners;
}

void Contraction::contract(Index winner) {
    const Index partner = list_of(winner)[0];
    Index kept = std::min(winner, partner), gone = std::max(winner, partner);
    const Vec3d from = records()[kept].position.cast<double>();
    const JoinedSamples joined = join(records()[kept], records()[gone], options_.placement);
    Vec3f position = (from + joined.offset).cast<float>();
    if (options_.placement == Placement::EndPoint) {
        if (joined.offset != Vec3d::Zero()) std::swap(kept, gone);
        position = records()[kept].position;
    }
    Record& record = records()[kept];
    record.position = position;
    record.quadric = StoredQuadric(referred_to(joined.quadric, position.cast<double>() - from));
    record.cost = kUnknown;
    record.link = gone | kMerged;
    records()[gone].link = kept;
    set_changed(kept);
    set_changed(gone);
}

void Contraction::contract(std::span<const Index> winners) {
    parallel_for_blocks(winners.size(), kBlock, context_, [&](std::size_t begin, std::size_t end) {
        for (std::size_t w = begin; w < end; ++w) contract(winners[w]);
    });
    if (options_.sequence == nullptr) return;
    for_blocks_in_order(winners.size(), context_, [&](std::size_t begin, std::size_t end) {
        for (const Index winner : winners.subspan(begin, end - begin)) {
            const Index partner = list_of(winner)[0];
            const bool stays = is_live(winner);
            const Index kept = stays ? winner : partner, gone = stays ? partner : winner;
            options_.sequence->emplace_back(order_[place(kept)], order_[place(gone)]);
        }
    });
}

/// Contracts what a round may, and stops where a count is reached on the way.
void Contraction::round(std::span<const std::uint64_t>& counts,
                        const std::function<void()>& at_count) {
    for_live([&](Index i) { refresh(i); });
    std::ranges::fill(changed_, 0);
    if (2 * live_ <= slots_) compact();
    const float limit = quantile_of_costs();
    std::vector<Index> winners = match(limit, CompareCosts::Exactly);
    if (winners.size() < live_ / kRoundsToHalve) {
        for_live([&](Index i) { records()[i].claim = kNone; });
        winners = match(limit, CompareCosts::Coarsely);
    }
    if (winners.empty()) return reconnect();

    if (options_.sequence != nullptr || live_ - winners.size() <= counts.front()) {
        std::ranges::sort(winners, until_stopped(context_, std::less<>()), [&](Index w) {
            return std::tuple(records()[w].cost, place(w), place(list_of(w)[0]));
        });
    }
    std::size_t done = 0;
    while (true) {
        const bool stop = live_ - winners.size() <= counts.front();
        const std::size_t end = stop ? live_ - counts.front() : winners.size();
        contract(std::span(winners).subspan(done, end - done));
        done = end;
        if (!stop) break;
        at_count();
        counts = counts.subspan(1);
        if (counts.empty()) return;
    }
    live_ -= winners.size();
}

/// Neighbours anew, where none are left to contract with: parts that are apart from each other.
void Contraction::reconnect() {
    std::vector<Vec3f> positions;
    compact();
    for_slots([&](Index i) { positions.push_back(records()[i].position); });
    const NearestLists lists = nearest_lists(positions, static_cast<unsigned>(k_), context_);
    for_slots([&](Index i) {
        std::ranges::copy(lists.of(i), list_of(i));
        records()[i].cost = kUnknown;
    });
}

/// Renumbers the slots so that the live samples fill them, and gives back the memory of the rest.
/// After a refresh, when all lists name live samples.
void Contraction::compact() {
    // The new numbers are claims until all is moved.
    Index next = 0;
    for_slots([&](Index i) {
        if (is_live(i)) records()[i].claim = next++;
    });
    for_slots([&](Index i) {
        if (!is_live(i)) records()[i].claim = records()[root(i)].claim;
    });
    const auto renumbered = [this](Index i) { return i == kNone ? kNone : records()[i].claim; };
    for_slots([&](Index i) {
        if (is_live(i))
            std::ranges::transform(std::span(list_of(i), k_), list_of(renumbered(i)), renumbered);
    });
    cut_off(neighbors_, live_ * k_);
    const bool first = slot_of_.empty();
    if (first) resize_in_blocks(slot_of_, order_.size(), context_);
    for_places([&](std::size_t place) {
        slot_of_[place] = renumbered(first ? static_cast<Index>(place) : slot_of_[place]);
    });
    if (first) resize_in_blocks(place_of_, live_, context_);
    for_slots([&](Index i) {
        if (!is_live(i)) return;
        const Index to = renumbered(i);
        place_of_[to] = first ? i : place_of_[i];
        records()[to] = records()[i];
        records()[to].link = to;
        records()[to].claim = kNone;
    });
    place_of_.resize(live_);
    slots_ = live_;
    memory_.shrink(slots_ * sizeof(Record));
}

ContractionSnapshot Contraction::snapshot() const {
    const bool ends = options_.placement == Placement::EndPoint;
    ContractionSnapshot s;
    auto number = made_in_blocks<std::vector<Index>>(slots_, context_);  // of live slots
    for_slots([&](Index i) {
        if (!is_live(i)) return;
        number[i] = static_cast<Index>(s.positions.size());
        s.positions.push_back(records()[i].position / static_cast<float>(scale_));
        if (ends)
            s.samples.push_back(order_[place(i)]);
        else
            s.quadrics.push_back(records()[i].quadric);
    });
    resize_in_blocks(s.survivor_of, order_.size(), context_);
    for_places(
        [&](std::size_t place) { s.survivor_of[order_[place]] = number[root(slot_at(place))]; });
    return s;
}

void Contraction::run(std::span<const std::uint64_t> counts,
                      const std::function<void(ContractionSnapshot&&)>& on_snapshot) {
    const std::uint64_t n = slots_;
    const auto at_count = [&] { on_snapshot(snapshot()); };
    for (; !counts.empty() && counts.front() >= n; counts = counts.subspan(1)) at_count();
    const std::uint64_t last = counts.empty() ? n : counts.back();
    const RunContext rounds = context_.part(kProgressToRounds, 1);
    while (!counts.empty()) {
        rounds.checkpoint(static_cast<double>(n - live_) / static_cast<double>(n - last));
        round(counts, at_count);
    }
}

}  // namespace

double contraction_scale(std::span<const Vec3f> positions, const RunContext& context) {
    float largest = 0;
    for_blocks_in_order(positions.size(), context, [&](std::size_t begin, std::size_t end) {
        for (const Vec3f& p : positions.subspan(begin, end - begin))
            largest = std::max(largest, p.cwiseAbs().maxCoeff());
    });
    return largest > 0 ? std::ldexp(1.0, -std::ilogb(largest)) : 1.0;
}

void contract(std::span<const Vec3f> positions, std::span<const StoredQuadric> quadrics,
              std::span<const std::uint64_t> counts, const ContractionOptions& options,
              const std::function<void(ContractionSnapshot&&)>& on_snapshot,
              const RunContext& context) {
    if (positions.size() >= kMerged) {
        throw Error(ErrorCode::TooLarge, std::to_string(positions.size()) +
                                             " points to contract: expected fewer than 2^31");
    }
    with_threads(context, [&] {
        Contraction(positions, quadrics, options, context).run(counts, on_snapshot);
    });
}

}  // namespace stipple
