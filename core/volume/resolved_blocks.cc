#include "core/volume/resolved_blocks.h"

#include <algorithm>
#include <atomic>
#include <cstddef>

#include "core/base/check.h"

namespace isoscope::volume {
namespace {

// Calls fn(index) for each block that has one of some cells, until it returns false.
template <typename Fn>
void ForEachBlockOf(const BlockLayout& layout, const math::IndexBox& cells, const Fn& fn) {
  math::IndexBox blocks;
  for (int axis = 0; axis < 3; ++axis) {
    blocks.begin[axis] = cells.begin[axis] / layout.block_cells()[axis];
    blocks.end[axis] = (cells.end[axis] - 1) / layout.block_cells()[axis] + 1;
  }
  for (std::int64_t z = blocks.begin.z; z < blocks.end.z; ++z) {
    for (std::int64_t y = blocks.begin.y; y < blocks.end.y; ++y) {
      for (std::int64_t x = blocks.begin.x; x < blocks.end.x; ++x) {
        if (!fn(math::Index3{x, y, z})) {
          return;
        }
      }
    }
  }
}

}  // namespace

math::IndexBox CellsUnder(const math::Index3& sample_dims, int level, const math::Index3& cell) {
  ISOSCOPE_CHECK_GE(level, 1);
  const std::int64_t size = std::int64_t{1} << level;
  math::IndexBox under;
  for (int axis = 0; axis < 3; ++axis) {
    // The cell's lowest sample lies half a sample behind this one.
    under.begin[axis] = cell[axis] * size + size / 2 - 1;
    under.end[axis] = under.begin[axis] + size + 1;
    ISOSCOPE_CHECK_LE(0, under.begin[axis]);
    ISOSCOPE_CHECK_LT(under.end[axis], sample_dims[axis]);
  }
  return under;
}

BlockSet BlocksThatMayResolve(const BlockLayout& coarse, const BlockSet& coarse_active, int level,
                              const BlockLayout& fine, const BlockTree& fine_active) {
  BlockSet chosen(coarse.block_count());
  for (const BlockId id : coarse_active.Ids()) {
    const math::IndexBox cells = coarse.CellsOf(id);
    const math::IndexBox under{
        CellsUnder(fine.sample_dims(), level, cells.begin).begin,
        CellsUnder(fine.sample_dims(), level, cells.end - math::Index3{1, 1, 1}).end};
    ForEachBlockOf(fine, under, [&](const math::Index3& block) {
      if (!fine_active.Contains(fine.IdOf(block))) {
        return true;
      }
      chosen.Insert(id);
      return false;
    });
  }
  return chosen;
}

ResolvedBlocks::ResolvedBlocks(const BlockLayout& fine, const BlockTree* active, int level)
    : fine_(fine), active_(*active), level_(level), marks_(active->words().size()) {
  ISOSCOPE_CHECK_GE(level, 1);
  ISOSCOPE_CHECK(active->block_dims() == fine.block_dims());
}

void ResolvedBlocks::AddCell(const math::Index3& cell) {
  ForEachBlockOf(
      fine_, CellsUnder(fine_.sample_dims(), level_, cell), [&](const math::Index3& block) {
        const std::int64_t code = active_.CodeOf(block);
        const std::uint32_t word_index = active_.cells()[static_cast<std::size_t>(code / 64)];
        const std::uint64_t bit = std::uint64_t{1} << (code % 64);
        if (word_index >= BlockTree::kEmpty || (active_.words()[word_index] & bit) == 0) {
          return true;
        }
        const std::atomic_ref<std::uint64_t> word(marks_[word_index]);
        // Most cells find their blocks marked: a read is cheaper.
        if ((word.load(std::memory_order_relaxed) & bit) == 0) {
          word.fetch_or(bit, std::memory_order_relaxed);
        }
        return true;
      });
}

}  // namespace isoscope::volume
