// The active cells of a block: those that have a part of a surface.

#ifndef ISOSCOPE_CORE_EXTRACT_ACTIVE_CELLS_H_
#define ISOSCOPE_CORE_EXTRACT_ACTIVE_CELLS_H_

#include <span>

#include "absl/functional/function_ref.h"

#include "core/math/box.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_samples.h"
#include "core/volume/inside_rule.h"

namespace isoscope::extract {

// Returns the least box of cells, in index space of the volume, around the active cells of a block
// that count; empty if there are none. A cell is active if a rule has samples of it on both sides,
// and none of its samples is NaN: then it has triangles.
//
// samples: the block's stored samples
// counts:  asked for active cells, by their lowest sample, where the box depends on it
//
// O(samples * rules).
math::IndexBox BoxOfActiveCells(const volume::BlockLayout& layout,
                                const volume::BlockSamples& samples,
                                std::span<const volume::InsideRule> rules,
                                absl::FunctionRef<bool(const math::Index3& cell)> counts);

// Calls visit(cell) for each active cell of a block, by its lowest sample, x fastest. O(samples).
void ForEachActiveCell(const volume::BlockLayout& layout, const volume::BlockSamples& samples,
                       const volume::InsideRule& rule,
                       absl::FunctionRef<void(const math::Index3& cell)> visit);

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_ACTIVE_CELLS_H_
