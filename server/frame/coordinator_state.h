// The state of a coordinator that its calls share: members, datasets, admission, memory, boards.
// Each part is thread-safe, and counts its own metrics.

#ifndef ISOSCOPE_SERVER_FRAME_COORDINATOR_STATE_H_
#define ISOSCOPE_SERVER_FRAME_COORDINATOR_STATE_H_

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "core/base/metrics.h"
#include "core/base/task_arena.h"
#include "core/base/trace_context.h"
#include "core/image/frame_image.h"
#include "core/image/pixel_mailboxes.h"
#include "core/view/camera.h"
#include "server/access/access_control.h"
#include "server/access/audit_log.h"
#include "server/admission/admission.h"
#include "server/admission/coordinator_memory.h"
#include "server/admission/frame_board.h"
#include "server/call/public_call.h"
#include "server/cluster/agent_failure.h"
#include "server/cluster/agent_metrics.h"
#include "server/cluster/agent_registry.h"
#include "server/cluster/frame_part.h"
#include "server/cluster/replica_board.h"
#include "server/frame/agent_queries.h"
#include "server/frame/frame_metrics.h"

namespace isoscope::server {

struct CoordinatorStateOptions {
  AgentRegistry* registry = nullptr;  // outlives the state, as access
  AccessControl* access = nullptr;
  int max_concurrent_frames = 4;           // >= 1
  int max_queued_frames = 32;              // >= 0
  std::shared_ptr<base::TaskArena> arena;  // for the coordinator's own computations
  std::size_t memory_limit_bytes = CoordinatorMemory::DefaultLimitBytes();
  CoordinatorMemory::AgentLimit agent_limit = nullptr;
  // Mailboxes of the agents, if all of them share this process; else null.
  std::shared_ptr<image::PixelMailboxes> mailboxes = nullptr;
  std::shared_ptr<AuditLog> audit = nullptr;  // null: none is kept
  // Images of this size are allocated at start. Not set: on demand.
  std::optional<view::Viewport> expected_viewport = std::nullopt;
};

struct CoordinatorState {
  explicit CoordinatorState(const CoordinatorStateOptions& options);

  // Returns the parts of a request that is not a frame.
  [[nodiscard]] std::vector<FramePart> PartsOf(const DatasetState& dataset) const {
    return replicas.Choose(dataset.replica_sets, dataset.dataset.dataset_id());
  }
  // Returns the turn of a query that one agent can answer (QueryTarget::turn).
  std::size_t NextTurn() { return next_turn.fetch_add(1, std::memory_order_relaxed); }

  // Logs and counts agents that failed (frame 0: in an export or a query), and reports to the
  // registry those that were lost or have changed.
  void ReportFailures(const base::TraceContext& request, std::int64_t frame_number,
                      const std::vector<AgentFailure>& failures);
  // Does the same for a query, and also counts late agents.
  void ReportQuery(const base::TraceContext& request, const QueryReport& report);

  struct FrameCounts {
    int working = 0;
    int queued = 0;
  };
  // Counts the frames on the board.
  [[nodiscard]] FrameCounts CountFrames() const;
  // Adds the metrics of all parts.
  void AppendMetrics(std::vector<base::MetricFamily>* families) const;

  AgentRegistry* const registry;
  const int max_concurrent_frames;
  const int max_queued_frames;
  const std::shared_ptr<base::TaskArena> arena;
  const std::shared_ptr<image::PixelMailboxes> mailboxes;
  CallDesk calls;
  CoordinatorMemory memory;
  FrameMetrics frame_metrics;
  AgentMetrics agent_metrics;
  FrameBoard board;  // the frames that have a place
  ReplicaBoard replicas;
  std::atomic<std::int64_t> next_frame_number{1};
  std::atomic<std::size_t> next_turn{0};
  const std::shared_ptr<image::FrameImagePool> images;
  Admission frames;  // their queue; comes last: its threads use the members above
};

// Logs that a replica was faster than the agent (frame 0: in a query).
void LogLostHedge(const base::TraceContext& request, std::int64_t frame_number,
                  const AgentIdentity& agent);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_COORDINATOR_STATE_H_
