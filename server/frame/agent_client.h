// The coordinator's calls to agents for a frame. Only the clients of agents, agent_prober and the
// service implementations know gRPC; frame_coordinator knows AgentLink.

#ifndef ISOSCOPE_SERVER_FRAME_AGENT_CLIENT_H_
#define ISOSCOPE_SERVER_FRAME_AGENT_CLIENT_H_

#include <cstddef>
#include <cstdint>
#include <memory>

#include "core/base/monotonic_time.h"
#include "core/base/trace_context.h"
#include "core/base/trace_recorder.h"
#include "core/image/pixel_mailboxes.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "isoscope/v1/trace.pb.h"
#include "server/cluster/frame_part.h"
#include "server/frame/agent_link.h"

namespace isoscope::server {

// Destination of the times of an agent's part.
struct AgentTraceTarget {
  base::TraceTime zero;  // of the axis
  // Set before the link's OnFrameDone, if the agent tells its times. Outlives the link.
  isoscope::v1::ProcessTrace* trace = nullptr;             // null: no trace was asked for
  std::size_t max_spans = base::TraceRecorder::kMaxSpans;  // that are kept of the agent's
};

// Begins a frame on an agent. `begin`: complete except for shard_indices and mailbox.
// `block_count`: blocks of the volume. `deadline`: the call ends by itself then. The listener
// outlives the link. `mailboxes`: mailboxes for the pixels of an agent in this process; else null.
std::unique_ptr<AgentLink> BeginFrameOnAgent(const AgentAssignment& agent,
                                             isoscope::internal::v1::BeginFrame begin,
                                             std::int64_t block_count, base::MonotonicTime deadline,
                                             image::PixelMailboxes* mailboxes,
                                             const base::TraceContext& identity,
                                             const AgentTraceTarget& trace_target,
                                             AgentListener* listener);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_AGENT_CLIENT_H_
