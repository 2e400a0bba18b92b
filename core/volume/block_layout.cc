#include "core/volume/block_layout.h"

#include <algorithm>

#include "absl/strings/str_format.h"

namespace isoscope::volume {

absl::StatusOr<BlockLayout> BlockLayout::Make(const math::Index3& sample_dims,
                                              const math::Index3& block_cells) {
  BlockLayout layout;
  layout.sample_dims_ = sample_dims;
  layout.block_cells_ = block_cells;
  double block_count = 1;
  for (int axis = 0; axis < 3; ++axis) {
    if (sample_dims[axis] < 2) {
      return absl::InvalidArgumentError(
          absl::StrFormat("volume of %d x %d x %d samples: at least 2 are needed on each axis",
                          sample_dims.x, sample_dims.y, sample_dims.z));
    }
    if (block_cells[axis] < 1 || block_cells[axis] > kMaxBlockCells) {
      return absl::InvalidArgumentError(
          absl::StrFormat("blocks of %d x %d x %d cells: 1 to %d on each axis", block_cells.x,
                          block_cells.y, block_cells.z, kMaxBlockCells));
    }
    const std::int64_t cells = sample_dims[axis] - 1;
    layout.block_dims_[axis] = (cells + block_cells[axis] - 1) / block_cells[axis];
    block_count *= static_cast<double>(layout.block_dims_[axis]);
  }
  if (block_count > static_cast<double>(kMaxBlockCount)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%.0f blocks of %d x %d x %d cells: at most %d; use larger blocks",
                        block_count, block_cells.x, block_cells.y, block_cells.z, kMaxBlockCount));
  }
  return layout;
}

math::Index3 BlockLayout::IndexOf(BlockId id) const {
  // Divides 32-bit ids: divisions of 64 bits take two to four times as long.
  const auto row_blocks = static_cast<BlockId>(block_dims_.x);
  const auto rows = static_cast<BlockId>(block_dims_.y);
  const BlockId row = id / row_blocks;
  return {id - row * row_blocks, row % rows, row / rows};
}

math::IndexBox BlockLayout::CellsOf(BlockId id) const {
  const math::Index3 index = IndexOf(id);
  math::IndexBox cells;
  for (int axis = 0; axis < 3; ++axis) {
    cells.begin[axis] = index[axis] * block_cells_[axis];
    cells.end[axis] = std::min(cells.begin[axis] + block_cells_[axis], sample_dims_[axis] - 1);
  }
  return cells;
}

math::IndexBox BlockLayout::OwnSamplesOf(BlockId id) const {
  math::IndexBox samples = CellsOf(id);
  samples.end = samples.end + math::Index3{1, 1, 1};
  return samples;
}

math::IndexBox BlockLayout::StoredSamplesOf(BlockId id) const {
  math::IndexBox samples = OwnSamplesOf(id);
  for (int axis = 0; axis < 3; ++axis) {
    samples.begin[axis] = std::max<std::int64_t>(samples.begin[axis] - 1, 0);
    samples.end[axis] = std::min(samples.end[axis] + 1, sample_dims_[axis]);
  }
  return samples;
}

math::Index3 DefaultBlockCells(const math::Index3& sample_dims) {
  constexpr std::int64_t kEnoughBlocks = 32768;
  for (const std::int64_t edge : {16, 12}) {
    // Saturates at kEnoughBlocks: the product of three axes could overflow.
    std::int64_t blocks = 1;
    for (int axis = 0; axis < 3; ++axis) {
      const std::int64_t cells = std::max<std::int64_t>(sample_dims[axis] - 1, 1);
      blocks = std::min(kEnoughBlocks, blocks * std::min(kEnoughBlocks, (cells + edge - 1) / edge));
    }
    if (blocks >= kEnoughBlocks) {
      return {edge, edge, edge};
    }
  }
  return {8, 8, 8};
}

}  // namespace isoscope::volume
