// The blocks of level 0 that a coarser level shows something of, and those that it hides.
//
// A block of level 0 is unresolved at a level if it is active and no cell of the level that
// overlaps it has a triangle: a vessel of one voxel may be gone there. The number of these blocks
// tells that something is hidden. It is no bound: a block may be resolved by another surface in it.
//
// Three things decide, of which only the last one needs samples:
//
//   active blocks of level 0        its spans, which every agent has
//   active blocks of the level      the level's range table: all other blocks have no triangle
//   cells with triangles in these   the samples of the level's blocks: each agent reads its own
//
// The resolved blocks of all agents are a union of sets. So neither their number nor the division
// of the level's blocks among them can show. The result depends on how level 0 is cut.

#ifndef ISOSCOPE_CORE_VOLUME_RESOLVED_BLOCKS_H_
#define ISOSCOPE_CORE_VOLUME_RESOLVED_BLOCKS_H_

#include <cstdint>
#include <vector>

#include "core/math/box.h"
#include "core/math/vec.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_set.h"
#include "core/volume/block_tree.h"

namespace isoscope::volume {

// Returns the cells of level 0 that a cell of a level overlaps. A sample of the level lies at the
// centre of the 2^level samples of level 0 on each axis that it was made of. So a cell begins in
// the middle of a cell of level 0, and overlaps 2^level + 1 of them. Pure.
//
// cell: by its lowest sample
//
// REQUIRES: level >= 1; the level of a volume with `sample_dims` samples has the cell.
math::IndexBox CellsUnder(const math::Index3& sample_dims, int level, const math::Index3& cell);

// Returns those of a level's active blocks whose cells overlap an active block of level 0: no other
// block can resolve one. O(blocks of the level, and under its active blocks).
//
// coarse, coarse_active: of the level
// fine, fine_active:     of level 0
BlockSet BlocksThatMayResolve(const BlockLayout& coarse, const BlockSet& coarse_active, int level,
                              const BlockLayout& fine, const BlockTree& fine_active);

// Collects the active blocks of level 0 that cells with triangles overlap. AddCell is thread-safe.
// Memory: 8 bytes for each brick of the tree.
class ResolvedBlocks {
 public:
  // fine:   of level 0
  // active: its active blocks; must outlive this
  //
  // REQUIRES: level >= 1.
  ResolvedBlocks(const BlockLayout& fine, const BlockTree* active, int level);

  // Adds the active blocks under a cell of the level that has a triangle. REQUIRES: as CellsUnder.
  void AddCell(const math::Index3& cell);

  // Returns the blocks, ascending. REQUIRES: no AddCell is under way.
  [[nodiscard]] std::vector<BlockId> Ids() const { return active_.IdsOf(marks_); }

 private:
  const BlockLayout fine_;
  const BlockTree& active_;
  const int level_;
  std::vector<std::uint64_t> marks_;  // in the shape of active_.words()
};

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_RESOLVED_BLOCKS_H_
