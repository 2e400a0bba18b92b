// The streaming calls of PartitionAgentService. Each owns itself until gRPC is done with it, and
// waits while kMaxQueuedBytes wait for the network.

#ifndef ISOSCOPE_PARTITION_AGENT_AGENT_STREAMS_H_
#define ISOSCOPE_PARTITION_AGENT_AGENT_STREAMS_H_

#include <cstddef>

#include <grpcpp/support/server_callback.h>

#include "core/base/units.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "partition-agent/agent_context.h"

namespace isoscope::agent {

// If this many bytes of pixels or surface wait for the network, the worker waits too.
inline constexpr std::size_t kMaxQueuedBytes = 8 * base::kMiB;

using FrameReactor = grpc::ServerBidiReactor<isoscope::internal::v1::RenderFrameRequest,
                                             isoscope::internal::v1::RenderFrameResponse>;
using SurfaceReactor = grpc::ServerWriteReactor<isoscope::internal::v1::ExtractSurfaceResponse>;

// `agent` outlives the calls.
FrameReactor* StartRenderFrame(AgentContext* agent, grpc::CallbackServerContext* context);
SurfaceReactor* StartExtractSurface(AgentContext* agent, grpc::CallbackServerContext* context,
                                    const isoscope::internal::v1::ExtractSurfaceRequest& request);

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_AGENT_STREAMS_H_
