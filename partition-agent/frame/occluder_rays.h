// Step 1 of a frame: the blocks that an agent's share of the rays hits.

#ifndef ISOSCOPE_PARTITION_AGENT_FRAME_OCCLUDER_RAYS_H_
#define ISOSCOPE_PARTITION_AGENT_FRAME_OCCLUDER_RAYS_H_

#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/trace_recorder.h"
#include "core/store/shard_reader.h"
#include "core/view/clip_region.h"
#include "core/view/view.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_tree.h"
#include "partition-agent/frame/frame_task.h"

namespace isoscope::agent {

// Returns the blocks of the volume, ascending, that the share hits first: active blocks of opaque
// surfaces that are not wholly clipped. Needs only the range table. Works in the arena of the
// calling thread. Returns the error of `cancellation` if it fires.
//
// trace:            may be null
// max_dense_blocks: a volume with more blocks is walked by trees: the same hits, in less time
absl::StatusOr<std::vector<volume::BlockId>> CastRays(
    const store::ShardReader& reader, const view::View& view, const view::Clipper& clipper,
    const FrameTask& task, const base::Cancellation& cancellation, base::TraceRecorder* trace,
    std::int64_t max_dense_blocks = volume::kMaxDenseBlocks);

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_FRAME_OCCLUDER_RAYS_H_
