// The division of a grid into blocks of cells.
//
// A cell is the hexahedron between 8 neighbouring samples; an axis has samples - 1 of them. Blocks
// tile the cells from index 0; the last block of an axis may be smaller. A block stores its own
// samples, one more than its cells on each axis, so that every cell belongs to exactly one block.
// For gradients it also stores one ghost sample on each side where the volume has one.
//
// Example: 11 samples on an axis are 10 cells; blocks of 4 cells:
//
//   block   cells   own samples   stored samples
//     0     0..3        0..4           0..5
//     1     4..7        4..8           3..9
//     2     8..9        8..10          7..10

#ifndef ISOSCOPE_CORE_VOLUME_BLOCK_LAYOUT_H_
#define ISOSCOPE_CORE_VOLUME_BLOCK_LAYOUT_H_

#include <cstdint>

#include "absl/status/statusor.h"

#include "core/math/box.h"
#include "core/math/vec.h"

namespace isoscope::volume {

// A block's index in the whole volume: x fastest, then y, then z. At most kMaxBlockCount - 1.
using BlockId = std::uint32_t;
inline constexpr std::int64_t kMaxBlockCount = 0xffffffff;  // the last value means "no block"

// Immutable; thread-safe.
class BlockLayout {
 public:
  BlockLayout() = default;

  // Makes a layout. INVALID_ARGUMENT unless every axis has >= 2 samples and
  // 1 <= block_cells <= kMaxBlockCells, and there are at most kMaxBlockCount blocks.
  static absl::StatusOr<BlockLayout> Make(const math::Index3& sample_dims,
                                          const math::Index3& block_cells);
  // Vertices of a block are counted in 16 + 16 bits, and its cells fit a cache.
  static constexpr std::int64_t kMaxBlockCells = 128;

  [[nodiscard]] const math::Index3& sample_dims() const { return sample_dims_; }
  [[nodiscard]] const math::Index3& block_cells() const { return block_cells_; }
  // Blocks on each axis.
  [[nodiscard]] const math::Index3& block_dims() const { return block_dims_; }
  [[nodiscard]] std::int64_t block_count() const { return math::Volume(block_dims_); }

  // REQUIRES for all below: id < block_count(), index within block_dims().
  [[nodiscard]] BlockId IdOf(const math::Index3& block_index) const {
    return static_cast<BlockId>(block_index.x +
                                block_dims_.x * (block_index.y + block_dims_.y * block_index.z));
  }
  [[nodiscard]] math::Index3 IndexOf(BlockId id) const;
  // Returns the block's cells.
  [[nodiscard]] math::IndexBox CellsOf(BlockId id) const;
  // Returns the samples that count for its span: one more than its cells on each axis.
  [[nodiscard]] math::IndexBox OwnSamplesOf(BlockId id) const;
  // Returns those plus the ghost layer, cut off at the volume's border.
  [[nodiscard]] math::IndexBox StoredSamplesOf(BlockId id) const;

 private:
  math::Index3 sample_dims_;
  math::Index3 block_cells_;
  math::Index3 block_dims_;
};

// Returns the default cells of a block: on each axis 16, or 12, if that leaves 32 768 blocks, 2048
// for each of 16 agents; else 8, so that agents have equal shares of smaller volumes
// (docs/decisions/0002-block-sizes.md). The result depends on the volume alone, because statistics
// count triangles block by block and must not change with the number of agents. REQUIRES:
// sample_dims >= 1.
math::Index3 DefaultBlockCells(const math::Index3& sample_dims);

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_BLOCK_LAYOUT_H_
