// All metrics of an agent. docs/operations.md lists them in a table; a test compares it with the
// output of Collect.

#ifndef ISOSCOPE_PARTITION_AGENT_MEMORY_AGENT_METRICS_H_
#define ISOSCOPE_PARTITION_AGENT_MEMORY_AGENT_METRICS_H_

#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"

#include "core/base/metrics.h"

namespace isoscope::agent {

// Every method of PartitionAgentService.
enum class AgentMethod {
  kDescribeShards,
  kRenderFrame,
  kExtractSurface,
  kGetShardHistogram,
  kGetActiveBox,
  kGetCellBox,
  kGetGradients,
  kGetDepthBounds,
  kGetResolvedBlocks,
};

// Present values that other objects keep.
struct AgentGauges {
  int frames = 0;      // begun and not ended
  int max_frames = 0;  // more are refused
  std::size_t shard_count = 0;
  int opening_shard_count = 0;  // they are served once all are open
  std::size_t damaged_shard_count = 0;
  std::size_t mesh_cache_bytes = 0;
  std::size_t sample_cache_bytes = 0;
  std::size_t active_cache_bytes = 0;
  std::size_t memory_limit_bytes = 0;
  double certificate_days_left = 0;
  std::int64_t certificate_failures = 0;  // could not be read
};

// Lookups in a cache, by result.
struct CacheLookups {
  base::Counter hits;
  base::Counter misses;
};

// Steps of plays that were read ahead, by what became of them.
struct StepsAhead {
  base::Counter used;    // a frame asked for it
  base::Counter wasted;  // another frame came instead
};

// Updated while the agent works, by atomics alone. Thread-safe.
struct AgentMetrics {
  AgentMetrics();

  void CountRequest(AgentMethod method, const absl::Status& status, absl::Duration duration);
  // Counts a frame that had begun.
  void CountFrame(const absl::Status& status, absl::Duration busy);

  base::Counter done_frames;
  base::Counter failed_frames;
  base::Counter cancelled_frames;
  base::Counter busy;  // a duration: work on frames that succeeded
  base::DurationHistogram queue_wait;
  base::DurationHistogram memory_wait;
  base::DurationHistogram select_occluders;
  base::DurationHistogram render_occluders;
  base::DurationHistogram render_visible;
  base::DurationHistogram encode;
  base::Counter triangles;
  base::Counter drawn_blocks;
  base::Counter reads;       // disk runs of blocks
  base::Counter read_bytes;  // of blocks and index pages, for frames
  base::Counter read_wait;   // a duration: steps that only waited for reads
  CacheLookups mesh_lookups;
  CacheLookups sample_lookups;
  CacheLookups active_lookups;  // lists of active blocks
  StepsAhead steps_ahead;

  // Returns the values above and `gauges`, with the metrics of the process.
  [[nodiscard]] std::vector<base::MetricFamily> Collect(const AgentGauges& gauges) const;

 private:
  base::RequestMetrics requests_;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_MEMORY_AGENT_METRICS_H_
