// All metrics of a coordinator. docs/operations.md lists them in a table; a test compares it with
// the output of Collect.

#ifndef ISOSCOPE_SERVER_METRICS_COORDINATOR_METRICS_H_
#define ISOSCOPE_SERVER_METRICS_COORDINATOR_METRICS_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

#include "core/base/metrics.h"
#include "server/cluster/agent_failure.h"

namespace isoscope::server {

// Every method of the public services.
enum class RequestMethod {
  kRenderIsosurface,
  kRenderIsosurfaceStream,
  kPickSurface,
  kExportIsosurface,
  kInteract,
  kListDatasets,
  kGetDataset,
  kGetHistogram,
  kGetCapabilities,
  kGetClusterStatus,
};

// "RenderIsosurface".
const char* NameOf(RequestMethod method);
// Limits of a token (docs/security.md) that refuse calls.
enum class TokenLimit { kFrameRate, kFrames, kStreams, kExports, kBytes };
inline constexpr std::size_t kTokenLimitCount = 5;

// The reason for ending an export or an interactive stream early.
enum class CutReason { kTooSlow, kTooLong, kMadeRoom, kTokenWithdrawn };
inline constexpr std::size_t kCutReasonCount = 4;

// Present values that other objects keep.
struct CoordinatorGauges {
  int working_frames = 0;
  int queued_frames = 0;
  int waiting_clients = 0;  // of the queued frames
  int outside_clients = 0;  // refused, and expected to retry
  int max_working_frames = 0;
  int max_queued_frames = 0;
  int reachable_agents = 0;
  int unreachable_agents = 0;
  int opening_agents = 0;
  int damaged_shards = 0;  // that agents report
  int complete_datasets = 0;
  int incomplete_datasets = 0;
  std::size_t memory_limit_bytes = 0;
  std::size_t frame_memory_bytes = 0;   // reserved by frames
  std::size_t export_memory_bytes = 0;  // reserved by exports
  double certificate_days_left = 0;
  std::int64_t certificate_failures = 0;  // could not be read
  std::int64_t token_failures = 0;        // the file was wrong after a change
  std::int64_t audit_lines = 0;
  std::int64_t audit_failures = 0;
};

// Frames and picks by their end.
struct FrameCounters {
  base::Counter done;
  base::Counter failed;     // except cancelled ones
  base::Counter cancelled;  // by the client, or because a newer view replaced it
  base::Counter refused;    // too many were in work or waiting, or others had priority
  base::Counter displaced;  // evicted while waiting; among the refused ones
  base::Counter expired;    // the deadline passed in the queue; among the failed ones
  base::Counter rate_limited;
  base::Counter too_large;  // above the memory limit
  base::Counter partial;
};

// Durations of frames and picks, of their waits and of their steps.
struct FrameDurations {
  base::DurationHistogram exact;  // whole, with picks
  base::DurationHistogram moving;
  base::DurationHistogram queue_wait;
  base::DurationHistogram memory_wait;
  base::DurationHistogram occluder_selection;
  base::DurationHistogram occluder_rendering;
  base::DurationHistogram visibility_culling;
  base::DurationHistogram composite;
  base::DurationHistogram encode;
};

// Parts of frames that a second agent worked on.
struct PartCounters {
  base::Counter repeated;     // of frames that succeeded all the same
  base::Counter hedged;       // begun on a replica too, because the agent was slow
  base::Counter lost_hedges;  // a replica finished first
};

// Updated while the coordinator works, by atomics and locks that are held only briefly.
// Thread-safe.
struct CoordinatorMetrics {
  // The most callers, and agents, that have a series of their own.
  static constexpr std::size_t kMaxCallers = 32;
  static constexpr std::size_t kMaxAgents = 64;

  CoordinatorMetrics();

  void CountRequest(RequestMethod method, const absl::Status& status, absl::Duration duration);
  // Counts a frame or a pick that ended after it had waited for a thread. `is_moving`: a frame of
  // an interactive stream in motion. `caller`: name of the token; "" without one.
  void CountFrame(const absl::Status& status, absl::Duration duration, bool is_moving,
                  absl::string_view caller);
  // Counts a call if `status` refuses it. Returns `status`.
  absl::Status CountRefusal(TokenLimit limit, absl::Status status);
  void CountCut(CutReason reason) { cuts_[static_cast<std::size_t>(reason)].Add(); }
  // Counts a frame that got no place, in its caller's series only.
  void CountRefused(absl::string_view caller);
  enum class PartOutcome { kDone, kFailed, kLostHedge };
  // Counts a part of a frame on an agent.
  void CountPart(absl::string_view agent_address, PartOutcome outcome);
  void CountAgentFailure(PartStage stage, const absl::Status& status);

  FrameCounters frames;
  FrameDurations durations;
  PartCounters parts;
  base::Counter network_bytes;
  base::Counter response_bytes;
  base::Counter active_blocks_hits;
  base::Counter active_blocks_misses;
  base::Gauge unsent_bytes;  // of answers that wait for their clients

  // Returns the values above and `gauges`, with the metrics of the process.
  [[nodiscard]] std::vector<base::MetricFamily> Collect(const CoordinatorGauges& gauges) const;

 private:
  static constexpr std::size_t kCodeCount = 17;

  enum CallerOutcome : std::size_t { kDone, kFailed, kCancelled, kRefused };

  base::RequestMetrics requests_;
  std::array<base::Counter, kTokenLimitCount> token_refusals_;
  std::array<base::Counter, kCutReasonCount> cuts_;
  base::CountersByName callers_;
  base::CountersByName agents_;
  std::array<std::array<base::Counter, kCodeCount>, kPartStageCount> agent_failures_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_METRICS_COORDINATOR_METRICS_H_
