// One frame in the coordinator: fan out, reduce, composite. No gRPC types.
//
// FrameProtocol decides the next action, Reduction holds the results of the agents, and RunFrame
// drives both. RunFrame owns the threads, the clock and the links.

#ifndef ISOSCOPE_SERVER_FRAME_FRAME_COORDINATOR_H_
#define ISOSCOPE_SERVER_FRAME_FRAME_COORDINATOR_H_

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "core/base/cancellation.h"
#include "core/frame/agent_statistics.h"
#include "server/admission/frame_board.h"
#include "server/frame/agent_link.h"
#include "server/frame/frame_protocol.h"
#include "server/frame/reduction.h"

namespace isoscope::server {

// The input of a frame. All objects that it points to outlive the frame.
struct FrameSetup : ReductionSetup, ReplicaSetup {
  // While more bytes of bands wait to be composited, no message of an agent is read.
  std::size_t max_waiting_bytes = std::numeric_limits<std::size_t>::max();
  std::atomic<FramePhase>* phase = nullptr;  // null: nobody looks
};

struct FrameResult : ReducedFrame {
  std::int64_t network_bytes = 0;
  absl::Duration occluder_selection_duration;
  absl::Duration occluder_rendering_duration;
  absl::Duration visibility_culling_duration;
  absl::Duration composite_duration;
  std::vector<frame::AgentStatistics> agents;  // in order of their first shard
};

// A frame that ran to its end.
struct FrameOutcome : AgentReport {
  absl::Status status = absl::OkStatus();  // OK: `result` is complete
  FrameResult result = {};
  // The parts that no agent could do when the frame failed, ascending: the one that ended it, and
  // those that were lost with it. Empty if the same error would occur in other parts.
  std::vector<std::size_t> lost_parts = {};
};

// Begins a part of the frame on the replica of this index; `listener` outlives the link.
using BeginAgentFrame = std::function<absl::StatusOr<std::unique_ptr<AgentLink>>(
    int part_index, int replica_index, AgentListener* listener)>;

// Runs one frame to its end. Blocks; a cancellation wakes it. An agent that fails is replaced by
// the next replica of its part. Without a replica the frame ends with AgentFailure::ToStatus, and
// the other agents are cancelled. The frame ends no later than the deadline of the cancellation,
// with a DEADLINE_EXCEEDED that names the agents that had not answered. The setup's arena decodes
// and composites bands in parallel, as they arrive.
FrameOutcome RunFrame(const FrameSetup& setup, const BeginAgentFrame& begin,
                      const base::Cancellation& cancellation);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_FRAME_COORDINATOR_H_
