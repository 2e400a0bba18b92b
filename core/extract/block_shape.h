// The bit masks of a block that depend on its shape only.
//
// Extraction treats a block's stored samples as one line: sample (x, y, z) of the block is bit
// x + y * row + z * slice, so that neighbours are shifts of whole bit rows and 64 samples are
// handled at once. The masks say which bits stand for edges and cells that are the block's.

#ifndef ISOSCOPE_CORE_EXTRACT_BLOCK_SHAPE_H_
#define ISOSCOPE_CORE_EXTRACT_BLOCK_SHAPE_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <vector>

#include "core/extract/bit_row.h"
#include "core/math/vec.h"
#include "core/volume/block_layout.h"

namespace isoscope::extract {

// Words of a mask are handled in groups of this many.
inline constexpr std::size_t kWordGroup = 8;

// Immutable after MakeBlockShape.
struct BlockShape {
  math::Index3 stored_dims;  // samples, ghosts included
  std::size_t row = 0;       // samples from (x, y, z) to (x, y + 1, z)
  std::size_t slice = 0;     // samples from (x, y, z) to (x, y, z + 1)
  std::size_t sample_count = 0;
  std::size_t word_count = 0;  // that hold samples: ceil(sample_count / 64)
  // Of each mask: word_count rounded up to whole groups. Bits past the samples are 0.
  std::size_t padded_word_count = 0;
  double row_inverse = 0;    // 1 / row
  double slice_inverse = 0;  // 1 / slice
  // Some own sample lacks a neighbour because the volume ends there.
  bool touches_border = false;
  // By axis, the bit of the edge's lower sample: edges of the block's cells, and those of them that
  // count for BlockMesh::owned_vertex_count.
  std::array<BitRow, 3> edges;
  std::array<BitRow, 3> owned_edges;
  // The bit of the cell's lowest sample.
  BitRow cells;
  // Lower samples of edges both of whose ends have all their neighbours in the block, whatever the
  // edge's axis.
  BitRow interior;
  std::uint32_t first_interior = 0;  // the lowest bit of `interior`, if there is one
  // [CaseTable::lanes value]: from 4 * (a cell's lowest sample) to 4 * (the edge's lower sample) +
  // axis.
  std::array<std::uint32_t, 32> lane_offsets{};
};

// O(samples).
BlockShape MakeBlockShape(const volume::BlockLayout& layout, volume::BlockId id);

// The shapes of a layout's blocks, each made when it is first asked for; blocks that lie alike at
// the volume's border share one. Thread-safe.
class BlockShapes {
 public:
  explicit BlockShapes(const volume::BlockLayout& layout) : layout_(layout) {}

  // Lives as long as this. REQUIRES: id < block_count().
  const BlockShape& Of(volume::BlockId id) const;

 private:
  // On each axis it counts whether the block is the first, the last, both or neither.
  static constexpr std::size_t kClassCount = 64;
  struct Slot {
    std::once_flag once;
    BlockShape shape;
  };
  [[nodiscard]] std::size_t ClassOf(volume::BlockId id) const;

  const volume::BlockLayout layout_;
  mutable std::array<Slot, kClassCount> slots_;
};

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_BLOCK_SHAPE_H_
