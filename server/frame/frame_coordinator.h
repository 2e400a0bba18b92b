// One frame in the coordinator: fan out, reduce, composite. No gRPC types.
//
// The reduces are a union of sets (step 1) and DecodePixelsInto (steps 2 and 3), both in core.
// They are associative, commutative and idempotent, so neither the number of agents nor the order
// of arrival shows in the result. The coordinator computes once all that follows from a reduce, and
// tells each agent its own part: its occluding blocks, then its blocks that the occluders do not
// hide. So these messages do not grow with the number of agents (docs/architecture.md).
//
// A part is some shards. Agents that serve all of them are its replicas: when one is lost or late,
// only its part is repeated, on the next one. All replicas have the frame's picture revision, so
// they make the same fragments, and a fragment that comes twice counts once.

#ifndef ISOSCOPE_SERVER_FRAME_FRAME_COORDINATOR_H_
#define ISOSCOPE_SERVER_FRAME_FRAME_COORDINATOR_H_

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include <oneapi/tbb/task_arena.h>

#include "core/base/cancellation.h"
#include "core/base/trace_recorder.h"
#include "core/frame/frame_spec.h"
#include "core/image/frame_image.h"
#include "core/image/layer_stack.h"
#include "core/view/view.h"
#include "core/volume/block_layout.h"
#include "server/admission/frame_board.h"
#include "server/frame/active_blocks.h"
#include "server/frame/agent_link.h"

namespace isoscope::server {

// The input of a frame. All objects that it points to outlive the frame.
struct FrameSetup {
  const frame::FrameSpec* spec = nullptr;
  const view::View* view = nullptr;  // the spec's
  const volume::BlockLayout* layout = nullptr;
  image::TieRule ties = image::TieRule::kColor;  // of the agents' back end
  // How many replicas can work on each part; at least 1.
  std::vector<int> replica_counts;
  // Returns true if a replica that a part is tried on no longer answers. Null: nobody knows.
  std::function<bool(int part_index, int replica_index)> is_lost;
  // Asked before a part that is only slow is also tried on a replica. Null: never.
  std::function<bool(int part_index, int replica_index)> may_hedge;
  // The active blocks, if they are known: then no agent may be asked to report them. May be null.
  std::shared_ptr<const ActiveBlocks> active;
  // While more bytes of bands wait to be composited, no message of an agent is read.
  std::size_t max_waiting_bytes = std::numeric_limits<std::size_t>::max();
  image::FrameImagePool* images = nullptr;
  tbb::task_arena* arena = nullptr;        // for what the coordinator computes
  base::TraceRecorder* trace = nullptr;    // null: none is asked for
  std::atomic<FrameStep>* step = nullptr;  // null: nobody looks
};

struct FrameResult {
  image::FrameImage image;
  // The translucent fragments, max_layers + 1 at most for a pixel; some may lie behind the image.
  image::LayerStack layers;
  // Those of the setup, or those that the agents reported. Null with kNone.
  std::shared_ptr<const ActiveBlocks> active;
  std::int64_t ray_hit_block_count = 0;
  std::int64_t network_bytes = 0;
  absl::Duration occluder_selection_duration;
  absl::Duration occluder_rendering_duration;
  absl::Duration visibility_culling_duration;
  absl::Duration composite_duration;
  std::vector<frame::AgentStatistics> agents;  // in order of their first shard
};

// A frame that ran to its end.
struct FrameOutcome {
  absl::Status status;  // OK: `result` is complete
  FrameResult result = {};
  // The agents that failed, also those whose part another one then did.
  std::vector<AgentFailure> failures = {};
  // The agents whose part a replica finished first.
  std::vector<AgentIdentity> outrun = {};
  // The parts that nobody could do when the frame failed, ascending: the one that ended it, and
  // those that were lost with it. Empty if the same would happen to other parts.
  std::vector<std::size_t> lost_parts = {};
  // Number of second attempts that may_hedge allowed.
  int hedge_count = 0;
};

// Begins a part of the frame on the replica of this index; `listener` outlives the link.
using BeginAgentFrame = std::function<absl::StatusOr<std::unique_ptr<AgentLink>>(
    int part_index, int replica_index, AgentListener* listener)>;

// Runs one frame to its end. Blocks; a cancellation wakes it. An agent that fails is replaced by
// the next replica of its part; without one the frame ends with AgentFailure::ToStatus, and the
// others are cancelled. The frame ends no later than the deadline of the cancellation, with a
// DEADLINE_EXCEEDED that names the agents that had not answered. The setup's arena decodes and
// composites bands in parallel, as they arrive.
FrameOutcome RunFrame(const FrameSetup& setup, const BeginAgentFrame& begin,
                      const base::Cancellation& cancellation);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_FRAME_COORDINATOR_H_
