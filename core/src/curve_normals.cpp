#include "curve_normals.hpp"

#include "first_touch.hpp"
#include "parallel_for.hpp"
#include "plane_kernels.hpp"

#include <algorithm>
#include <cstddef>

namespace stipple {

namespace {

constexpr std::size_t kLanes = PlaneLanes::kLanes, kBeside = 3;  // leaves that are looked at
static_assert(kLanes == PointTree::kWidth);

/// The normals of the points of one leaf.
class LeafNormals {
public:
    explicit LeafNormals(const PointTree& tree)
        : tree_(tree),
          lanes_(neighbors_of(tree.size()), kBeside * kLanes),
          kernel_(plane_kernel()) {}

    void run(std::size_t leaf, std::vector<Vec3f>& normals) {
        const PointTree::Leaf& own = tree_.leaf(leaf);
        const Vec3f origin = own.position(0);
        const std::size_t end = std::min(std::max<std::size_t>(leaf, 1) + 2, tree_.leaf_count());
        lanes_.rows = 0;
        for (std::size_t l = end - std::min(end, kBeside); l < end; ++l) {
            for (std::size_t i = 0; i < tree_.points_in(l); ++i) {
                const Vec3f p = tree_.leaf(l).position(i) - origin;
                PlaneLanes::Row& row = lanes_.candidates[lanes_.rows++];
                row.x.fill(p.x());
                row.y.fill(p.y());
                row.z.fill(p.z());
            }
        }
        const std::size_t n = tree_.points_in(leaf);
        for (std::size_t lane = 0; lane < kLanes; ++lane) {
            const Vec3f p = own.position(std::min(lane, n - 1)) - origin;
            lanes_.place.x[lane] = p.x();
            lanes_.place.y[lane] = p.y();
            lanes_.place.z[lane] = p.z();
        }
        lanes_.query = lanes_.place;
        kernel_.run(lanes_);
        lanes_.radius_guess_sq = lanes_.radius_sq;  // of the next leaf
        for (std::size_t lane = 0; lane < n; ++lane) {
            const PlaneLanes::Row& found = lanes_.normal;
            normals[own.index[lane]] = lanes_.flat[lane]
                                           ? Vec3f(found.x[lane], found.y[lane], found.z[lane])
                                           : Vec3f(Vec3f::UnitZ());
        }
    }

private:
    static unsigned neighbors_of(std::size_t points) noexcept {
        constexpr std::size_t kNeighbors = 13;  // the point itself is one of them
        return static_cast<unsigned>(std::min(kNeighbors, points));
    }

    const PointTree& tree_;
    PlaneLanes lanes_;
    PlaneKernel kernel_;
};

}  // namespace

std::vector<Vec3f> curve_normals(const PointTree& tree, const RunContext& context) {
    constexpr std::size_t kLeaves = 128;
    auto normals = made_in_blocks<std::vector<Vec3f>>(tree.size(), context);
    parallel_for_blocks(tree.leaf_count(), kLeaves, context,
                        [&](std::size_t begin, std::size_t end) {
                            LeafNormals leaves(tree);
                            for (std::size_t l = begin; l < end; ++l) {
                                leaves.run(l, normals);
                            }
                        });
    return normals;
}

}  // namespace stipple
