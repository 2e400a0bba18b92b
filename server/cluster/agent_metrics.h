// Counts what agents do for frames and other requests: parts, second attempts, failures.

#ifndef ISOSCOPE_SERVER_CLUSTER_AGENT_METRICS_H_
#define ISOSCOPE_SERVER_CLUSTER_AGENT_METRICS_H_

#include <array>
#include <cstddef>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

#include "core/base/metrics.h"
#include "server/cluster/agent_failure.h"

namespace isoscope::server {

// Thread-safe.
struct AgentMetrics {
  // The most agents that have a series of their own.
  static constexpr std::size_t kMaxAgents = 64;

  enum class PartOutcome { kDone, kFailed, kLostHedge };
  // Counts a part of a frame on an agent.
  void CountPart(absl::string_view agent_address, PartOutcome outcome) {
    parts_.Add(agent_address, static_cast<std::size_t>(outcome));
  }
  void CountFailure(PartStage stage, const absl::Status& status);

  void AppendMetrics(std::vector<base::MetricFamily>* families) const;

  // Parts of frames that a second agent worked on.
  base::Counter repeated;     // of frames that succeeded all the same
  base::Counter hedged;       // begun on a replica too, because the agent was slow
  base::Counter lost_hedges;  // a replica finished first

 private:
  static constexpr std::size_t kCodeCount = 17;

  base::CountersByName parts_{"agent", {"done", "failed", "outrun"}, kMaxAgents};
  std::array<std::array<base::Counter, kCodeCount>, kPartStageCount> failures_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_CLUSTER_AGENT_METRICS_H_
