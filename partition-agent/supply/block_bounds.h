// The bounds of depth of a part of a volume's blocks, from the spans that every agent has.

#ifndef ISOSCOPE_PARTITION_AGENT_SUPPLY_BLOCK_BOUNDS_H_
#define ISOSCOPE_PARTITION_AGENT_SUPPLY_BLOCK_BOUNDS_H_

#include <cstdint>

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/task_arena.h"
#include "core/frame/frame_spec.h"
#include "core/store/shard_reader.h"
#include "core/view/view.h"
#include "core/visibility/depth_bounds.h"
#include "core/volume/block_tree.h"

namespace isoscope::agent {

// A part of the blocks, of part_count about equal ones: block ids in order.
struct BlockPart {
  int part_index = 0;
  int part_count = 1;
};

// Returns the bounds in the view's picture: of blocks that are active for any surface of the spec,
// and with caps of those with an inside sample of an opaque surface. The least and the greatest of
// all parts are those of the volume. Reads no samples. Works in `arena`; blocks.
//
// Memory: beside the picture and the active blocks that the reader keeps, some MiB.
//
// reader:           of any shard of the volume
// max_dense_blocks: the active blocks of a volume with more are taken from trees: the same bounds
//
// Errors: those of pages of spans; that of `cancellation` if it fires between two steps.
absl::StatusOr<visibility::DepthBounds> BoundsOfPart(
    const store::ShardReader& reader, const view::View& view, const frame::FrameSpec& spec,
    const BlockPart& part, base::TaskArena* arena, const base::Cancellation& cancellation,
    std::int64_t max_dense_blocks = volume::kMaxDenseBlocks);

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_SUPPLY_BLOCK_BOUNDS_H_
