// A running agent: its shards behind a gRPC server. The main function of isoscope-agent and the
// embedded cluster of the command line use it.

#ifndef ISOSCOPE_PARTITION_AGENT_AGENT_SERVER_H_
#define ISOSCOPE_PARTITION_AGENT_AGENT_SERVER_H_

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include <grpcpp/channel.h>

#include "core/base/cancellation.h"
#include "core/base/executor.h"
#include "core/base/metrics.h"
#include "core/base/task_arena.h"
#include "core/image/pixel_mailboxes.h"
#include "core/render/renderer.h"
#include "core/store/sample_reader.h"
#include "partition-agent/memory/agent_memory.h"
#include "rpc/signs_of_life.h"
#include "rpc/transport.h"

namespace isoscope::agent {

struct AgentServerOptions {
  // Shard directories, or dataset directories, which stand for all their shards.
  std::vector<std::string> directories;
  // "HOST:PORT"; port 0 takes a free one. Empty: no port, in-process channels only.
  std::string listen_address;
  // Shared by all agents of a process.
  std::shared_ptr<render::Renderer> renderer;
  std::shared_ptr<base::TaskArena> arena;
  std::shared_ptr<AgentMemory> memory;
  // Opens the sources of index-only shards; empty: there may be none. Takes at most
  // memory->source_bytes() and source_index_bytes().
  store::OpenSamples open_samples = nullptr;
  // Mailboxes of a coordinator in this process, which takes pixels from there; else null.
  std::shared_ptr<image::PixelMailboxes> mailboxes = nullptr;
  // The most frames in work at a time. Others wait, or are refused with RESOURCE_EXHAUSTED.
  int max_concurrent_frames = 4;
  int max_queued_frames = 64;
  // Runs the steps of frames, for all agents of a process. With threads of their own, hundreds of
  // agents would have thousands of threads that wake at once. Must have room for the steps of
  // max_concurrent_frames + max_queued_frames frames of each agent. Null: the agent makes one.
  std::shared_ptr<base::Executor> frame_executor = nullptr;
  // Each step of a frame computes on its own thread, not in the arena. This is for a process with
  // many more agents than threads: steps that all use the arena spend more on waking its threads
  // than on work.
  bool one_thread_a_step = false;
  // Whether errors go to callers on other machines: paths of this one stay in its log.
  bool hides_paths = false;
  // With TLS, only coordinators may call.
  rpc::TransportFlags transport = {};
  bool has_reflection = true;
  // An export that works on but has nothing to send tells so this often.
  absl::Duration sign_of_life_interval = rpc::kSignOfLifeInterval;
};

// Thread-safe.
class AgentServer {
 public:
  // Opens the shards, then serves health, reflection and PartitionAgentService. Errors as Open and
  // Listen.
  static absl::StatusOr<std::unique_ptr<AgentServer>> Start(const AgentServerOptions& options);
  // Reads the manifests of the shards, no table, then serves. Until Open has succeeded, health is
  // NOT_SERVING, DescribeShards tells the datasets and the progress, and other calls fail with
  // UNAVAILABLE (ErrorReason::kAgentOpening). NOT_FOUND if a directory is not there or has no
  // shard; other errors as rpc::CheckFiles; UNAVAILABLE if the address can't be bound.
  static absl::StatusOr<std::unique_ptr<AgentServer>> Listen(const AgentServerOptions& options);
  // Calls Shutdown without grace.
  virtual ~AgentServer() = default;

  // Opens the shards, calls `settle`, which may be null, and serves them unless that fails. Call it
  // once, after Listen. Blocks on the disk; CANCELLED soon after `cancellation` has fired, which
  // outlives the server. Other errors as OpenShard, and of `settle`.
  virtual absl::Status Open(const base::Cancellation& cancellation,
                            const std::function<absl::Status()>& settle) = 0;
  // How far Open is. "3 of 8 shards are open, ...".
  [[nodiscard]] virtual std::string opening_summary() const = 0;

  // The bound port, or 0 without one.
  [[nodiscard]] virtual int port() const = 0;
  virtual std::shared_ptr<grpc::Channel> InProcessChannel() = 0;
  // Text for operators: "head 0,2 of 4; noise 1 of 2". "" until the shards are open.
  [[nodiscard]] virtual std::string shard_summary() const = 0;
  // Frames whose call has not ended yet; 0: no step of any frame runs.
  [[nodiscard]] virtual int frames_in_work() const = 0;
  // Returns the metrics for monitoring (agent_metrics).
  virtual std::vector<base::MetricFamily> CollectMetrics() = 0;
  // Reports in later answers that this agent stops soon, and sets health to NOT_SERVING. Calls are
  // served as before, so that those on their way do not fail.
  virtual void AnnounceDrain() = 0;
  // Sets health to NOT_SERVING, takes no new calls, waits up to `grace` for calls in work, then
  // cancels them. Blocks.
  virtual void Shutdown(absl::Duration grace) = 0;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_AGENT_SERVER_H_
