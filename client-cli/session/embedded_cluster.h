// A coordinator and one agent for each shard of one or several datasets, in this process: the same
// servers as isoscope-coordinator and isoscope-agent run, joined by in-process channels.

#ifndef ISOSCOPE_CLIENT_CLI_SESSION_EMBEDDED_CLUSTER_H_
#define ISOSCOPE_CLIENT_CLI_SESSION_EMBEDDED_CLUSTER_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

#include "core/render/renderer_kind.h"
#include "core/view/camera.h"
#include "rpc/transport.h"

namespace grpc {  // NOLINT(readability-identifier-naming): theirs
class Channel;
}  // namespace grpc

namespace isoscope::agent {
class AgentServer;
}  // namespace isoscope::agent

namespace isoscope::render {
class Renderer;
}  // namespace isoscope::render

namespace isoscope::server {
class CoordinatorServer;
}  // namespace isoscope::server

namespace isoscope::cli {

struct EmbeddedClusterOptions {
  std::string dataset_directory;
  // Further datasets, of other names.
  std::vector<std::string> more_dataset_directories = {};
  render::RendererKind renderer = render::RendererKind::kAuto;
  // Threads that extract and draw, for all agents together; 0: one for each core.
  int thread_count = 0;
  // Limit for all agents together; at least AgentMemory::kMinLimitBytes, or 0: AgentMemory's
  // default.
  std::size_t memory_limit_bytes = 0;
  // "HOST:PORT"; empty: reached in-process only.
  std::string listen_address;
  // With TLS or tokens, callers of that address must authenticate.
  rpc::TransportFlags transport = {};
  std::string token_file = {};
  // The server's limit for one request.
  absl::Duration max_frame_duration = absl::Minutes(5);
  // Memory is allocated early for frames of this size; null: on demand.
  std::optional<view::Viewport> expected_viewport = std::nullopt;
  // There will be one frame: memory is allocated on demand, since what is touched early takes longer
  // than it saves.
  bool draws_once = false;
  // FrameSpec::max_layers of such a frame if it has translucent surfaces, else 0: a refusal names
  // the memory limit that it needs.
  int expected_layers = 0;
};

// Says in a sentence that fewer threads draw than `options` ask for, or than there are cores, because
// its memory limit has no room for more. Empty if it has.
std::string DescribeFewerThreads(const EmbeddedClusterOptions& options);

// A memory limit of agents, as ParseByteSize; at least AgentMemory::kMinLimitBytes.
absl::StatusOr<std::int64_t> ParseAgentMemory(absl::string_view text);

// Thread-safe. The destructor shuts down with no grace.
class EmbeddedCluster {
 public:
  // Returns once frames can be rendered. NOT_FOUND: no dataset there. FAILED_PRECONDITION: shards
  // are missing (names them), or the renderer can't start. DATA_LOSS: damaged. UNAVAILABLE: the
  // address can't be bound.
  static absl::StatusOr<std::unique_ptr<EmbeddedCluster>> Start(
      const EmbeddedClusterOptions& options);
  ~EmbeddedCluster();
  EmbeddedCluster(const EmbeddedCluster&) = delete;
  EmbeddedCluster& operator=(const EmbeddedCluster&) = delete;

  std::shared_ptr<grpc::Channel> Channel();
  // As CoordinatorServer::SetGatewayAddress.
  void SetGatewayAddress(const std::string& address);
  // The bound port, or 0 without one.
  [[nodiscard]] int port() const;
  [[nodiscard]] int shard_count() const { return static_cast<int>(agents_.size()); }
  // Names the back end and its device, for the user.
  [[nodiscard]] std::string renderer_description() const;
  // Lets frames in work finish for at most `grace`. Blocks.
  void Shutdown(absl::Duration grace);

 private:
  EmbeddedCluster();

  std::shared_ptr<render::Renderer> renderer_;
  std::vector<std::unique_ptr<agent::AgentServer>> agents_;
  std::unique_ptr<server::CoordinatorServer> coordinator_;
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_SESSION_EMBEDDED_CLUSTER_H_
