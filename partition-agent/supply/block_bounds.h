// The bounds of depth of a part of a volume's blocks, from the range table that every agent has.

#ifndef ISOSCOPE_PARTITION_AGENT_SUPPLY_BLOCK_BOUNDS_H_
#define ISOSCOPE_PARTITION_AGENT_SUPPLY_BLOCK_BOUNDS_H_

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/task_arena.h"
#include "core/frame/frame_spec.h"
#include "core/view/view.h"
#include "core/visibility/depth_bounds.h"
#include "core/volume/block_layout.h"
#include "core/volume/range_table.h"

namespace isoscope::agent {

// A part of the blocks, of part_count about equal ones: block ids in order.
struct BlockPart {
  int part_index = 0;
  int part_count = 1;
};

// Returns the bounds in the view's picture: of blocks that are active for any surface of the spec,
// and with caps of those with an inside sample of an opaque surface. The least and the greatest of
// all parts are those of the volume. Reads nothing. Works in `arena`; blocks. The error of
// `cancellation` if it fires between two steps.
absl::StatusOr<visibility::DepthBounds> BoundsOfPart(const volume::BlockLayout& layout,
                                                     const volume::RangeTable& ranges,
                                                     const view::View& view,
                                                     const frame::FrameSpec& spec,
                                                     const BlockPart& part, base::TaskArena* arena,
                                                     const base::Cancellation& cancellation);

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_SUPPLY_BLOCK_BOUNDS_H_
