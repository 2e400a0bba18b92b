// A running coordinator. The main function of isoscope-coordinator and the embedded cluster of the
// command line use it.

#ifndef ISOSCOPE_SERVER_COORDINATOR_SERVER_H_
#define ISOSCOPE_SERVER_COORDINATOR_SERVER_H_

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include <grpcpp/channel.h>

#include "core/base/metrics.h"
#include "core/base/monotonic_time.h"
#include "core/base/task_arena.h"
#include "core/frame/frame_spec.h"
#include "core/image/pixel_mailboxes.h"
#include "core/view/camera.h"
#include "rpc/signs_of_life.h"
#include "rpc/transport.h"
#include "server/admission/export_pace.h"
#include "server/cluster/agent_endpoint.h"

namespace isoscope::server {

struct CoordinatorServerOptions {
  std::vector<AgentEndpoint> agents;
  // "HOST:PORT"; port 0 takes a free one. Empty: no port, in-process channels only.
  std::string listen_address;
  int max_concurrent_frames = 4;
  int max_queued_frames = 32;
  // The longest time of a frame. Shorter deadlines of clients hold.
  absl::Duration max_frame_duration = absl::Minutes(5);
  // The longest silence of an agent that sends a surface to export.
  absl::Duration max_agent_silence = absl::Minutes(5);
  // An export that has nothing to send tells its client this often that it goes on.
  absl::Duration sign_of_life_interval = rpc::kSignOfLifeInterval;
  // Limits of an export, and of its client's speed.
  ExportLimits export_limits = {};
  // The memory limit (CoordinatorMemory); at least CoordinatorMemory::kMinLimitBytes. 0: the
  // default.
  std::size_t memory_limit_bytes = 0;
  // If the agents are of this process, and the same flag raises their limit
  // (CoordinatorMemory::AgentLimit). Null: they have their own.
  std::function<std::size_t(const frame::FrameSpec& spec)> agent_limit = nullptr;
  // The interval between two polls of the agents.
  absl::Duration poll_interval = absl::Seconds(2);
  // The arena of the coordinator's computations; null: an arena of all cores.
  std::shared_ptr<base::TaskArena> arena;
  // Mailboxes of the agents, if all of them share this process: pixels are then passed without
  // encoding. Else null.
  std::shared_ptr<image::PixelMailboxes> mailboxes = nullptr;
  // The web gateway's address, as GetCapabilities returns it; empty: none.
  std::string gateway_address = {};
  // With TLS, agents are dialled with it too, and callers must show a certificate or a token.
  rpc::TransportFlags transport = {};
  // The file of tokens (access_tokens.h); empty: none.
  std::string token_file = {};
  // The file of the audit log (audit_log.h); empty: none.
  std::string audit_log = {};
  bool has_reflection = true;
  // The coordinator allocates frames of this size at start. Not set: it allocates on demand.
  std::optional<view::Viewport> expected_viewport = std::nullopt;
};

// Thread-safe.
class CoordinatorServer {
 public:
  // Serves health, reflection, IsosurfaceService, InteractService, DatasetService and
  // ClusterService. Begins to ask the agents at once, and returns without waiting for them.
  // INVALID_ARGUMENT: no agents, or a malformed target. UNAVAILABLE: the address can't be bound.
  // Errors of the files as rpc::CheckFiles and ParseAccessTokens.
  static absl::StatusOr<std::unique_ptr<CoordinatorServer>> Start(
      const CoordinatorServerOptions& options);
  // Calls Shutdown without grace.
  virtual ~CoordinatorServer() = default;

  [[nodiscard]] virtual int port() const = 0;
  virtual std::shared_ptr<grpc::Channel> InProcessChannel() = 0;
  // Blocks until every agent has answered at least once and at least one dataset is complete, or
  // until `deadline`. FAILED_PRECONDITION names the missing part.
  virtual absl::Status WaitUntilReady(base::MonotonicTime deadline) = 0;
  // Sets the address of a web gateway that starts later, for GetCapabilities. Thread-safe.
  virtual void SetGatewayAddress(const std::string& address) = 0;
  // Returns the metrics of all parts, for monitoring.
  virtual std::vector<base::MetricFamily> CollectMetrics() = 0;
  // Sets health to NOT_SERVING, takes no new calls, waits up to `grace` for frames in work, then
  // cancels them. Blocks.
  virtual void Shutdown(absl::Duration grace) = 0;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_COORDINATOR_SERVER_H_
