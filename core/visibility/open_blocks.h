// Before step 3 of a frame, in a large volume: finds the active blocks that the occlusion map does
// not hide, without a look at each of them.
//
// Over the bricks of a BlockTree lies an 8-fold tree of cubes: 4, 8, 16, ... blocks on a side. If the
// map hides a cube, it hides every block in it. So only cubes with an open pixel are taken apart.

#ifndef ISOSCOPE_CORE_VISIBILITY_OPEN_BLOCKS_H_
#define ISOSCOPE_CORE_VISIBILITY_OPEN_BLOCKS_H_

#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/types/span.h"

#include "core/math/vec.h"
#include "core/view/clip_region.h"
#include "core/view/view.h"
#include "core/visibility/occlusion_map.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_tree.h"

namespace isoscope::visibility {

// The cubes of a tree of blocks that have members. Immutable; thread-safe. Memory: 1.2 bytes for
// each brick of the volume.
class BlockCubes {
 public:
  // O(bricks of the volume). `blocks` must outlive it.
  explicit BlockCubes(const volume::BlockTree& blocks);

  // Returns the marks, in the shape of blocks.words(), of the members that are not in `skipped`, whose
  // footprint is not empty, that are not wholly clipped, and that the map does not hide: those of a
  // test of each member. Works in parallel in the caller's TBB arena.
  //
  // skipped: marks; may be empty
  //
  // REQUIRES: layout, view and clipper are of the blocks' volume; the map is of the view's picture.
  [[nodiscard]] std::vector<std::uint64_t> OpenBlocks(
      const view::View& view, const volume::BlockLayout& layout, const view::Clipper& clipper,
      const OcclusionMap& map, absl::Span<const std::uint64_t> skipped) const;

  [[nodiscard]] std::size_t size_bytes() const;

 private:
  // Cubes of 2^level bricks on a side, x fastest: whether they have members.
  struct Level {
    math::Index3 dims;
    std::vector<char> has_members;
  };

  // Returns the footprint of a cube, grown so that it covers that of each block in it.
  [[nodiscard]] static view::Footprint FootprintOf(const view::View& view,
                                                   const volume::BlockLayout& layout,
                                                   std::size_t level, const math::Index3& cube);

  const volume::BlockTree& blocks_;
  std::vector<Level> levels_;  // the last has one cube
};

}  // namespace isoscope::visibility

#endif  // ISOSCOPE_CORE_VISIBILITY_OPEN_BLOCKS_H_
