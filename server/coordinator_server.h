// A running coordinator. Used by isoscope-coordinator's main and by the embedded cluster of the
// command line.

#ifndef ISOSCOPE_SERVER_COORDINATOR_SERVER_H_
#define ISOSCOPE_SERVER_COORDINATOR_SERVER_H_

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include <grpcpp/channel.h>
#include <oneapi/tbb/task_arena.h>

#include "core/view/camera.h"

namespace isoscope::server {

// Where an agent is.
struct AgentEndpoint {
  // Any gRPC target. "dns:///NAME:PORT" stands for every address behind the name, and is resolved
  // again when agents come and go.
  std::string target;
  // Used instead of dialling, if set: an embedded agent's in-process channel.
  std::shared_ptr<grpc::Channel> channel;
};

struct CoordinatorServerOptions {
  std::vector<AgentEndpoint> agents;
  // "HOST:PORT"; port 0 takes a free one. Empty: no port, in-process channels only.
  std::string listen_address;
  int max_concurrent_frames = 4;
  int max_queued_frames = 32;
  // How long a frame without a deadline may take; also the cap of longer ones.
  absl::Duration max_frame_duration = absl::Minutes(5);
  // How often agents are asked what they hold.
  absl::Duration poll_interval = absl::Seconds(2);
  // Where the coordinator computes; null: on all cores.
  std::shared_ptr<tbb::task_arena> arena;
  // Memory is taken early for frames of this size; null: as they come.
  std::optional<view::Viewport> expected_viewport = std::nullopt;
};

// Thread-safe.
class CoordinatorServer {
 public:
  // Serves health, reflection, IsosurfaceService, DatasetService and ClusterService; begins to ask
  // the agents at once and returns without waiting for them. INVALID_ARGUMENT: no agents, or a
  // malformed target. UNAVAILABLE: the address can't be bound.
  static absl::StatusOr<std::unique_ptr<CoordinatorServer>> Start(
      const CoordinatorServerOptions& options);
  // Shutdown with no grace.
  virtual ~CoordinatorServer() = default;

  [[nodiscard]] virtual int port() const = 0;
  virtual std::shared_ptr<grpc::Channel> InProcessChannel() = 0;
  // Blocks until every agent has answered at least once and at least one dataset is complete, or
  // until `deadline`. FAILED_PRECONDITION says what is missing.
  virtual absl::Status WaitUntilReady(absl::Time deadline) = 0;
  // Health NOT_SERVING, no new calls, waits for frames in work up to `grace`, then cancels them.
  // Blocks.
  virtual void Shutdown(absl::Duration grace) = 0;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_COORDINATOR_SERVER_H_
