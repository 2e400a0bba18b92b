// The coordinator's calls to agents for a frame and for a surface. Only this file, agent_prober and
// the service implementations know gRPC; frame_coordinator knows AgentLink.

#ifndef ISOSCOPE_SERVER_AGENT_CLIENT_H_
#define ISOSCOPE_SERVER_AGENT_CLIENT_H_

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>
#include <grpcpp/support/sync_stream.h>

#include "core/base/trace_context.h"
#include "core/base/trace_recorder.h"
#include "core/image/pixel_mailboxes.h"
#include "core/mesh/block_mesh.h"
#include "core/volume/block_layout.h"
#include "isoscope/internal/v1/partition_agent_service.grpc.pb.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "isoscope/v1/trace.pb.h"
#include "server/agent_link.h"
#include "server/surface_export.h"

namespace isoscope::server {

// An agent that can be reached, and the shards that it works on.
struct AgentAssignment {
  std::string address;
  std::shared_ptr<grpc::Channel> channel;
  std::vector<int> shard_indices;  // ascending

  [[nodiscard]] AgentIdentity identity() const { return {address, shard_indices}; }
};

// Returns how a call to an agent ended, as AgentFailure::status. Keeps codes, except those that
// would mislead the client: INVALID_ARGUMENT (the coordinator's message was wrong) becomes
// INTERNAL, and a stream that was cut, but not by us, becomes UNAVAILABLE.
absl::Status CallStatus(const absl::Status& status, bool was_cancelled_by_us);

// Where the times of an agent's part go.
struct AgentTraceTarget {
  base::TraceTime zero;  // of the axis
  // Set before the link's OnFrameDone, if the agent tells its times. Outlives the link.
  isoscope::v1::ProcessTrace* trace = nullptr;  // null: nobody asks
};

// Begins a frame on an agent. `begin`: complete except for shard_indices and mailbox.
// `block_count`: blocks of the volume. `deadline`: the call ends by itself then. The listener
// outlives the link. `mailboxes`: those that the agent puts pixels into, if it shares this process;
// else null.
std::unique_ptr<AgentLink> BeginFrameOnAgent(const AgentAssignment& agent,
                                             isoscope::internal::v1::BeginFrame begin,
                                             std::int64_t block_count, absl::Time deadline,
                                             image::PixelMailboxes* mailboxes,
                                             const base::TraceContext& identity,
                                             const AgentTraceTarget& trace_target,
                                             AgentListener* listener);

// The surface of one agent's blocks, pulled message by message. While nobody pulls, gRPC's flow
// control stops the agent. Cancel is thread-safe, the other functions are for one thread.
class SurfaceStream final : public SurfaceSource {
 public:
  // request: shard_indices is set to the agent's.
  SurfaceStream(const AgentAssignment& agent, const volume::BlockLayout& layout,
                isoscope::internal::v1::ExtractSurfaceRequest request, absl::Time deadline,
                const base::TraceContext& identity);
  // Cancels the call if it has not ended.
  ~SurfaceStream() override;
  SurfaceStream(const SurfaceStream&) = delete;
  SurfaceStream& operator=(const SurfaceStream&) = delete;

  // Blocks. Errors name the agent; INTERNAL if it sent a malformed block.
  absl::StatusOr<bool> Next(mesh::BlockMesh* block) override;
  void Cancel();

  // Returns OK, or the error of Next without the agent's name.
  [[nodiscard]] const absl::Status& status() const { return status_; }
  [[nodiscard]] const AgentIdentity& agent() const { return agent_; }

 private:
  // Keeps the status, and returns it with the agent's name.
  absl::Status Fail(absl::Status status);

  const AgentIdentity agent_;
  absl::Status status_;
  const volume::BlockLayout layout_;
  const std::unique_ptr<isoscope::internal::v1::PartitionAgentService::Stub> stub_;
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReader<isoscope::internal::v1::ExtractSurfaceResponse>> reader_;
  isoscope::internal::v1::ExtractSurfaceResponse message_;
  int next_block_ = 0;  // index in message_
  std::atomic<bool> was_cancelled_{false};
  bool has_ended_ = false;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_AGENT_CLIENT_H_
