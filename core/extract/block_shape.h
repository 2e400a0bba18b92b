// The bit masks of a block that depend on its shape alone.
//
// Extraction treats a block's stored samples as one line: sample (x, y, z) of the block is bit
// x + y * row + z * slice. So neighbours are shifts of whole bit rows, and one operation handles 64
// samples. The masks say which bits stand for edges and cells of the block: the line also has bits
// for ghosts, and for edges that would run from the end of a row to the next.

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

// Kernels take the words of a mask in groups of this many.
inline constexpr std::size_t kWordGroup = 8;

// Immutable after MakeBlockShape.
struct BlockShape {
  math::Index3 stored_dims;  // samples, ghosts included
  std::size_t row = 0;       // samples from (x, y, z) to (x, y + 1, z)
  std::size_t slice = 0;     // samples from (x, y, z) to (x, y, z + 1)
  std::size_t sample_count = 0;
  std::size_t word_count = 0;  // words with samples: ceil(sample_count / 64)
  // Words of each mask: word_count rounded up to whole groups. Bits past the samples are 0.
  std::size_t padded_word_count = 0;
  double row_inverse = 0;    // 1 / row
  double slice_inverse = 0;  // 1 / slice
  // True if an own sample lacks a neighbour because the volume ends there.
  bool touches_border = false;
  // By axis, the bit of the edge's lower sample: the edges of the block's cells, and those of them
  // that count for BlockMesh::owned_vertex_count.
  std::array<BitRow, 3> edges;
  std::array<BitRow, 3> owned_edges;
  // The block's cells: the bit of the cell's lowest sample.
  BitRow cells;
  // Samples from which an edge along any axis has all neighbours of both its ends in the block.
  BitRow interior;
  std::uint32_t first_interior = 0;  // the lowest bit of `interior`, if any is set
  // By lane of CaseTable::lanes: the distance in vertex_ids from the cell's lowest sample to the
  // edge's entry, 4 * (offset of the edge's lower sample) + axis.
  std::array<std::uint32_t, 32> lane_offsets{};
};

// Returns the shape of a block. O(samples).
BlockShape MakeBlockShape(const volume::BlockLayout& layout, volume::BlockId id);

// The shapes of a layout's blocks. Blocks that lie alike at the volume's border share a shape,
// which is made on first use. Thread-safe.
class BlockShapes {
 public:
  explicit BlockShapes(const volume::BlockLayout& layout) : layout_(layout) {}

  // The result lives as long as this object. REQUIRES: id < block_count().
  const BlockShape& Of(volume::BlockId id) const;

 private:
  // The class of a block has two bits an axis: is it the first block, is it the last?
  static constexpr std::size_t kClassCount = 64;
  struct LazyShape {
    std::once_flag once;
    BlockShape shape;
  };
  [[nodiscard]] std::size_t ClassOf(volume::BlockId id) const;

  const volume::BlockLayout layout_;
  mutable std::array<LazyShape, kClassCount> shapes_;  // by class
};

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_BLOCK_SHAPE_H_
