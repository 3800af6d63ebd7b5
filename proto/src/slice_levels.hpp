#pragma once

#include "stipple/proto/slice.hpp"
#include "stipple/proto/tiles.hpp"

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

namespace stipple::proto {

/// Points of a level that lie in the box, and how far that level is from the source.
struct LevelCut {
    std::size_t level = 0;
    PointCloud cloud;
    std::optional<FileError> error;
};

/// The levels of a pyramid as slices are cut from them: as far as they lie in a box, read from PLY
/// files or tiles.
class SliceLevels {
public:
    /// All are kept by reference.
    /// @throws Error(InvalidArgument) for a pyramid whose files are of no format that is read.
    SliceLevels(const Results& pyramid, const SliceOptions& options, const FileReader& read,
                const RunContext& context);

    /// Whether the level is read from tiles.
    bool tiled(const OutputCloud& level) const;
    /// The most points that the level can have in the box.
    std::uint64_t most_points(const OutputCloud& level) const;
    /// That of the level, or of its tiles here: where they are read, and where it was not measured.
    std::optional<FileError> error_of(const OutputCloud& level) const;
    /// @throws Error(TooLarge) where the level has more points here than are read.
    std::shared_ptr<const LevelCut> read_level(std::size_t number) const;
    /// The coarsest level with so many points in the box, or the finest.
    /// @throws Error(NotFound) where no point lies in the box.
    std::shared_ptr<const LevelCut> level_with(std::uint64_t points);
    /// @throws Error(NotFound) that tells where the points are.
    [[noreturn]] void refuse_empty_box() const;

private:
    bool keep_attributes(const OutputCloud& level) const;
    bool in_box(const OutputFile& file) const;
    Aabb box_of(const LodTile& tile) const;
    Aabb reach_of(const LodTile& tile) const;
    std::optional<Vec3d> middle_of_tiles(const OutputCloud& level) const;
    template <typename Visit>
    void for_tiles(const OutputCloud& level, Visit&& visit) const;
    std::uint64_t bytes_of_point(const OutputCloud& level) const;
    void require_readable(const OutputCloud& level) const;
    PointCloud read_ply(const OutputFile& file, std::uint64_t points) const;
    void read_tiles(const OutputCloud& level, PointCloud& cloud) const;

    const Results& pyramid_;
    const PyramidJob& job_;
    const SliceOptions& options_;
    const FileReader& read_;
    const RunContext& context_;
    Vec3d center_;          ///< of the source's box: tiles are relative to it
    Vec3d middle_of_most_;  ///< points, where there is a box
    Vec3d origin_;          ///< of the source's positions
    std::vector<std::shared_ptr<const LevelCut>> cuts_;  ///< of the levels that were read
};

}  // namespace stipple::proto
