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
#include <vector>

#include "core/math/vec.h"
#include "core/volume/block_layout.h"

namespace isoscope::extract {

using BitRow = std::vector<std::uint64_t>;

// Immutable after MakeBlockShape.
struct BlockShape {
  math::Index3 stored_dims;  // samples, ghosts included
  std::size_t row = 0;       // samples from (x, y, z) to (x, y + 1, z)
  std::size_t slice = 0;     // samples from (x, y, z) to (x, y, z + 1)
  std::size_t sample_count = 0;
  std::size_t word_count = 0;  // of each mask: ceil(sample_count / 64)
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
};

// O(samples).
BlockShape MakeBlockShape(const volume::BlockLayout& layout, volume::BlockId id);

// Blocks of one layout with equal numbers (< kShapeClassCount) have equal shapes: on each axis it
// counts only whether the block is the first, the last, both or neither.
inline constexpr std::size_t kShapeClassCount = 64;
std::size_t ShapeClassOf(const volume::BlockLayout& layout, volume::BlockId id);

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_BLOCK_SHAPE_H_
