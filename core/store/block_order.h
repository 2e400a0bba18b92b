// The order of blocks in a shard: cubes of 4 x 4 x 4 blocks one after the other, x fastest, and the
// blocks of each along a Hilbert curve that ends beside the next cube. Blocks that lie near each
// other in space lie near each other in the file; and what is cut four layers of blocks at a time
// is written from the front to the back.
// Source of the curve: Hilbert 1891, "Ueber die stetige Abbildung einer Linie auf ein
// Flaechenstueck"; in three dimensions as in Skilling 2004, "Programming the Hilbert curve".

#ifndef ISOSCOPE_CORE_STORE_BLOCK_ORDER_H_
#define ISOSCOPE_CORE_STORE_BLOCK_ORDER_H_

#include <cstdint>

#include "core/math/box.h"
#include "core/math/vec.h"
#include "core/volume/block_layout.h"

namespace isoscope::store {

// Blocks on each edge of a cube.
inline constexpr std::int64_t kCubeEdge = 4;

// Of two blocks of a layout, the one with the lesser key comes first; no two have the same.
std::uint64_t BlockOrderKey(const volume::BlockLayout& layout, volume::BlockId id);

// How many blocks of `box`, in blocks, come before the one at `index`, which lies in it. O(1).
std::int64_t RankInBox(const math::IndexBox& box, const math::Index3& index);

// The blocks of a box, not empty, in their order.
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
  math::Index3 cube_;         // its first block, perhaps outside of the box
  std::uint64_t places_ = 0;  // on the curve, of the cube's blocks from this one on
};

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_BLOCK_ORDER_H_
