// The order of blocks in a shard (docs/format/shard.md, "Blocks and their order").
//
// Cubes of 4 x 4 x 4 blocks follow each other, x fastest. In each cube the blocks follow a Hilbert
// curve that ends beside the next cube. So neighbours in space are neighbours in the file, and a
// partitioner that cuts four layers of blocks at a time writes the file from front to back.
//
// Source of the curve: Hilbert 1891, "Ueber die stetige Abbildung einer Linie auf ein
// Flaechenstueck"; in three dimensions Skilling 2004 (references.bib: skilling-hilbert).

#ifndef ISOSCOPE_CORE_STORE_BLOCK_ORDER_H_
#define ISOSCOPE_CORE_STORE_BLOCK_ORDER_H_

#include <cstdint>

#include "core/math/box.h"
#include "core/math/vec.h"
#include "core/volume/block_layout.h"

namespace isoscope::store {

// Blocks along each edge of a cube.
inline constexpr std::int64_t kCubeEdge = 4;

// The key by which blocks are ordered: smaller keys come first, no two blocks of a layout have the
// same. O(1).
std::uint64_t BlockOrderKey(const volume::BlockLayout& layout, volume::BlockId id);

// The number of blocks of `box` that come before the block at `index`. O(1).
// box: in blocks. REQUIRES: `index` lies in it.
std::int64_t RankInBox(const math::IndexBox& box, const math::Index3& index);

// Visits the blocks of a box in their order. REQUIRES: the box is not empty. Thread-compatible.
//
//   for (BlocksInOrder blocks(box); !blocks.is_at_end(); blocks.Next()) { … blocks.index() … }
class BlocksInOrder {
 public:
  explicit BlocksInOrder(const math::IndexBox& box);

  [[nodiscard]] bool is_at_end() const { return cube_.z >= box_.end.z; }
  // REQUIRES for both: !is_at_end().
  [[nodiscard]] math::Index3 index() const;
  void Next();

 private:
  math::IndexBox box_;
  math::Index3 cube_;            // first block of the current cube; may lie outside the box
  std::uint64_t remaining_ = 0;  // curve mask: blocks of the cube that were not passed yet
};

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_BLOCK_ORDER_H_
