// One frame in the coordinator: fan out, reduce, composite. No gRPC types.
//
// The reduces are pure functions of core: UnionOfHits (step 1), CompositeInto (steps 2 and 3),
// OcclusionMap::FromImage. All are associative, commutative and idempotent where they reduce, so
// neither the number of agents nor the order of arrival shows in the result.

#ifndef ISOSCOPE_SERVER_FRAME_COORDINATOR_H_
#define ISOSCOPE_SERVER_FRAME_COORDINATOR_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "core/base/cancellation.h"
#include "core/image/frame_image.h"
#include "core/view/view.h"
#include "core/visibility/culling.h"
#include "server/agent_link.h"

namespace isoscope::server {

struct FrameResult {
  image::FrameImage image;
  std::int64_t ray_hit_block_count = 0;
  std::int64_t network_bytes = 0;
  absl::Duration occluder_selection_duration;
  absl::Duration occluder_rendering_duration;
  absl::Duration visibility_culling_duration;
  absl::Duration composite_duration;
  std::vector<AgentStatistics> agents;  // in order of their first shard
};

// Begins the frame on agent `agent_index` of all; `listener` outlives the link.
using BeginAgentFrame = std::function<absl::StatusOr<std::unique_ptr<AgentLink>>(
    int agent_index, AgentListener* listener)>;

// Runs one frame to its end. Blocks. Any agent's error ends the frame with that error and cancels
// the others; the frame ends no later than the cancellation's deadline, with DEADLINE_EXCEEDED
// naming the agents that had not answered. Decodes and composites bands on the calling thread as
// they come.
absl::StatusOr<FrameResult> RunFrame(const view::View& view, visibility::Culling culling,
                                     int agent_count, const BeginAgentFrame& begin,
                                     const base::Cancellation& cancellation);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_COORDINATOR_H_
