// Runs frames for the calls of IsosurfaceService: counts them, finds dataset and agents, and keeps
// the state that frames share.

#ifndef ISOSCOPE_SERVER_FRAME_FRAME_RUNNER_H_
#define ISOSCOPE_SERVER_FRAME_FRAME_RUNNER_H_

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "core/base/cancellation.h"
#include "core/base/task_arena.h"
#include "core/base/trace_context.h"
#include "core/base/trace_recorder.h"
#include "core/frame/frame_spec.h"
#include "core/image/frame_image.h"
#include "core/image/pixel_mailboxes.h"
#include "core/view/camera.h"
#include "core/view/view.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "server/access/access_control.h"
#include "server/access/audit_log.h"
#include "server/admission/admission.h"
#include "server/admission/coordinator_memory.h"
#include "server/admission/frame_board.h"
#include "server/cluster/agent_failure.h"
#include "server/cluster/agent_registry.h"
#include "server/cluster/frame_part.h"
#include "server/cluster/replica_board.h"
#include "server/cluster/series_state.h"
#include "server/frame/active_blocks.h"
#include "server/frame/agent_queries.h"
#include "server/frame/frame_coordinator.h"
#include "server/frame/render_statistics.h"
#include "server/metrics/coordinator_metrics.h"
#include "wire/frame_convert.h"

namespace isoscope::server {

struct FrameRunnerOptions {
  AgentRegistry* registry = nullptr;       // outlives the runner
  int max_concurrent_frames = 4;           // >= 1
  int max_queued_frames = 32;              // >= 0
  std::shared_ptr<base::TaskArena> arena;  // for the coordinator's own computations
  std::size_t memory_limit_bytes = CoordinatorMemory::DefaultLimitBytes();
  CoordinatorMemory::AgentLimit agent_limit = nullptr;
  // Mailboxes of the agents, if all of them share this process; else null.
  std::shared_ptr<image::PixelMailboxes> mailboxes = nullptr;
  std::shared_ptr<AuditLog> audit = nullptr;  // null: none is kept
  // The runner allocates frames of this size at start. Not set: it allocates on demand.
  std::optional<view::Viewport> expected_viewport = std::nullopt;
};

// A dataset, the parts of a frame on it, and its view.
struct FrameTarget {
  std::shared_ptr<const DatasetState> dataset;
  std::vector<FramePart> parts;  // of all shards, unless some are missing (allow_partial)
  view::View view;
  volume::BlockLayout layout;
  image::FragmentOrder order;
  SelectedVolume selected;  // `dataset` is its dataset
};

using wire::AskedFrame;

// A frame apart from its content: caller, deadline and observers. All objects that it points to
// outlive the frame.
struct FrameIdentity {
  std::int64_t number = 0;
  const base::TraceContext* request = nullptr;
  const Caller* caller = nullptr;
  const base::Cancellation* cancellation = nullptr;
  std::atomic<FramePhase>* phase = nullptr;  // null: no observer
  base::TraceRecorder* trace = nullptr;      // null: no trace was asked for
  base::TraceTime trace_zero = {};           // of the axis
  // Gets the traces of the agents, in their order, if `trace` is set.
  std::vector<isoscope::v1::ProcessTrace>* agent_traces = nullptr;
};

// Thread-safe.
class FrameRunner {
 public:
  explicit FrameRunner(const FrameRunnerOptions& options);

  // Takes a place for a frame of `client`, a token's name or a peer. RESOURCE_EXHAUSTED with a
  // retry delay if there is none, or if the frame can never fit the memory limit. Does not block.
  absl::StatusOr<Admission::Place> Admit(const std::string& client, const frame::FrameSpec& spec,
                                         Delivery delivery, bool has_trace = false);
  // The queue of frames, for scheduling a frame that has a place.
  [[nodiscard]] Admission* admission() { return &admission_; }

  // Takes the memory of a frame, and waits until it is free. Errors as CoordinatorMemory.
  absl::StatusOr<base::MemoryBudget::Reservation> ReserveMemory(
      const frame::FrameSpec& spec, Delivery delivery, bool has_trace,
      const base::Cancellation& cancellation) {
    return memory_.ReserveFrame(spec, delivery, cancellation, TraceBytes(has_trace));
  }
  // The most spans that the coordinator records of a frame with a trace. Its agents may have three
  // times as many.
  [[nodiscard]] std::size_t max_own_spans() const {
    return std::min(memory_.max_trace_spans() / 4, base::TraceRecorder::kMaxSpans);
  }

  // Takes the memory of an export; the same otherwise.
  absl::StatusOr<base::MemoryBudget::Reservation> ReserveExportMemory(
      std::size_t agent_count, const base::Cancellation& cancellation) {
    return memory_.ReserveExport(agent_count, cancellation);
  }

  std::int64_t NextFrameNumber() { return next_frame_number_.fetch_add(1); }
  [[nodiscard]] base::TaskArena* arena() const { return options_.arena.get(); }
  [[nodiscard]] image::FrameImagePool* images() const { return images_.get(); }

  // Finds the dataset of a frame, among those that the caller may see, and checks that its agents
  // can draw it. Resolves the camera. Errors as IsosurfaceService says.
  absl::StatusOr<FrameTarget> FindTarget(const FrameIdentity& identity, AskedFrame* asked);

  // Runs one frame to its end. Blocks. Errors as IsosurfaceService says; logs agents that failed.
  // With allow_partial, `parts` loses those that no agent could do, and the frame shows the others.
  absl::StatusOr<FrameResult> Run(const FrameIdentity& identity, const AskedFrame& asked,
                                  const FrameTarget& target, std::vector<FramePart>* parts);
  // Sets the missing shards of a frame of `parts`, if any, and the share of the surface that it
  // has.
  absl::Status AddMissingShards(const FrameIdentity& identity, const AskedFrame& asked,
                                const FrameTarget& target, const std::vector<FramePart>& parts,
                                FrameCost* cost);

  // Returns the parts of a request that is not a frame.
  [[nodiscard]] std::vector<FramePart> PartsOf(const DatasetState& dataset) const {
    return replicas_.Choose(dataset.replica_sets, dataset.dataset.dataset_id());
  }

  // Logs and counts agents that failed (frame 0: in an export or a query), and reports to the
  // registry those that were lost or have changed.
  void ReportFailures(const base::TraceContext& request, std::int64_t frame_number,
                      const std::vector<AgentFailure>& failures);

  // Does the same for a query, and also counts late agents.
  void ReportQuery(const base::TraceContext& request, const QueryReport& report);
  // Returns the turn of a query that one agent can answer (QueryTarget::turn).
  std::size_t NextTurn() { return next_turn_.fetch_add(1, std::memory_order_relaxed); }
  // Counts a call that has ended, and writes its line of the audit log.
  void EndRequest(RequestMethod method, const AuditRecord& record,
                  const base::TraceContext& request, const absl::Status& status,
                  absl::Duration duration);
  // Null: there is no audit log.
  [[nodiscard]] AuditLog* audit() const { return options_.audit.get(); }

  // The frames that have a place.
  [[nodiscard]] FrameBoard* board() { return &board_; }
  [[nodiscard]] CoordinatorMetrics* metrics() { return &metrics_; }
  // The gauges that the metrics do not count themselves, except those of agents and datasets.
  [[nodiscard]] CoordinatorGauges gauges() const;

 private:
  [[nodiscard]] std::size_t TraceBytes(bool has_trace) const {
    return has_trace ? memory_.trace_bytes() : 0;
  }
  class Attempt;
  // Resolves the camera of the frame. Asks an agent for the box of the surface if the camera fits
  // it.
  absl::Status PlaceCamera(const FrameIdentity& identity, const QueryTarget& query,
                           const volume::GridGeometry& geometry, const volume::BlockLayout& layout,
                           AskedFrame* asked);

  const FrameRunnerOptions options_;
  CoordinatorMemory memory_;
  CoordinatorMetrics metrics_;
  FrameBoard board_;
  std::atomic<std::int64_t> next_frame_number_{1};
  std::atomic<std::size_t> next_turn_{0};
  ActiveBlocksCache active_blocks_;
  ReplicaBoard replicas_;
  const std::shared_ptr<image::FrameImagePool> images_;
  Admission admission_;  // comes last: its threads use the members above
};

// Returns the layout of the dataset's blocks. INVALID_ARGUMENT if it has none.
absl::StatusOr<volume::BlockLayout> LayoutOf(const isoscope::v1::Dataset& dataset,
                                             const volume::GridGeometry& geometry);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_FRAME_RUNNER_H_
