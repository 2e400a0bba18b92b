// The coordinator's calls to agents for one frame and one surface. Here, in agent_prober and in the
// service implementations gRPC begins; frame_coordinator knows AgentLink.

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

#include "core/mesh/block_mesh.h"
#include "core/volume/block_layout.h"
#include "isoscope/internal/v1/partition_agent_service.grpc.pb.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
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

// How a call to an agent ended, as AgentFailure::status has it. Codes are kept, but for those that
// would tell the client something wrong: INVALID_ARGUMENT (the coordinator's message was bad)
// becomes INTERNAL, and a stream that was cut without us becomes UNAVAILABLE.
absl::Status CallStatus(const absl::Status& status, bool was_cancelled_by_us);

// Begins a frame on an agent. `begin`: complete but for shard_indices. `block_count`: of the whole
// volume. The listener outlives the link. `deadline`: when the call ends by itself.
std::unique_ptr<AgentLink> BeginFrameOnAgent(const AgentAssignment& agent,
                                             isoscope::internal::v1::BeginFrame begin,
                                             std::int64_t block_count, absl::Time deadline,
                                             AgentListener* listener);

// The surface of one agent's blocks, pulled message by message: while nobody pulls, gRPC's flow
// control stops the agent. Cancel is thread-safe, the rest is for one thread.
class SurfaceStream final : public SurfaceSource {
 public:
  SurfaceStream(const AgentAssignment& agent, const std::string& dataset_id,
                const volume::BlockLayout& layout, double isovalue, absl::Time deadline);
  // Cancels, if it has not ended.
  ~SurfaceStream() override;
  SurfaceStream(const SurfaceStream&) = delete;
  SurfaceStream& operator=(const SurfaceStream&) = delete;

  // Blocks. Errors name the agent; INTERNAL if it sent a malformed block.
  absl::StatusOr<bool> Next(mesh::BlockMesh* block) override;
  void Cancel();

  // OK, or why Next failed, without the agent's name.
  [[nodiscard]] const absl::Status& status() const { return status_; }
  [[nodiscard]] const AgentIdentity& agent() const { return agent_; }

 private:
  // Keeps the status, and names the agent in it.
  absl::Status Fail(absl::Status status);

  const AgentIdentity agent_;
  absl::Status status_;
  const volume::BlockLayout layout_;
  const std::unique_ptr<isoscope::internal::v1::PartitionAgentService::Stub> stub_;
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReader<isoscope::internal::v1::ExtractSurfaceResponse>> reader_;
  isoscope::internal::v1::ExtractSurfaceResponse message_;
  int next_block_ = 0;  // of message_
  std::atomic<bool> was_cancelled_{false};
  bool has_ended_ = false;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_AGENT_CLIENT_H_
