// The parts of an agent that its calls share.

#ifndef ISOSCOPE_PARTITION_AGENT_AGENT_CONTEXT_H_
#define ISOSCOPE_PARTITION_AGENT_AGENT_CONTEXT_H_

#include <atomic>
#include <memory>

#include "core/base/executor.h"
#include "core/base/trace_recorder.h"
#include "core/render/renderer.h"
#include "partition-agent/agent_server.h"
#include "partition-agent/begun_frames.h"
#include "partition-agent/memory/agent_metrics.h"
#include "partition-agent/memory/agent_resources.h"
#include "partition-agent/opening.h"
#include "partition-agent/play_ahead.h"
#include "partition-agent/shard_damage.h"
#include "partition-agent/shard_set.h"

namespace isoscope::agent {

// Thread-safe. Outlives the calls.
//
// A frame holds a thread only while a step runs, not while it waits for the coordinator. At most
// max_frames frames are in work at a time. Extractions have threads of their own, because a slow
// reader holds one for as long as it reads. So have queries, which go through all blocks. Queries
// for the values of labels read all samples: they have one thread of their own, behind which
// neither histograms nor picks wait.
struct AgentContext {
  static constexpr int kMaxConcurrentExtractions = 4;
  static constexpr int kMaxQueuedExtractions = 16;
  static constexpr int kMaxConcurrentQueries = 2;
  static constexpr int kMaxQueuedQueries = 64;
  static constexpr int kMaxConcurrentLabelQueries = 1;
  static constexpr int kMaxQueuedLabelQueries = 64;
  static constexpr int kMaxQueuedDescriptions = 64;

  // Its shards are being opened.
  explicit AgentContext(const AgentServerOptions& server_options);

  // Serves them from now on. Call it once.
  void Serve(Shards plain, SeriesShards series);

  // `trace`: the recorder of a frame that has one.
  [[nodiscard]] AgentResources Resources(base::TraceRecorder* trace);
  // Returns the present values that other objects keep, without those of the certificate.
  [[nodiscard]] AgentGauges Gauges() const;

  const AgentServerOptions options;
  Opening opening;
  BegunFrames begun;
  ShardDamages damages;
  ShardSet shards;
  const std::unique_ptr<render::Renderer> cpu_renderer;  // null if options.renderer is one
  const int max_frames;
  std::atomic<int> frame_count{0};  // calls that have not ended yet
  AgentMetrics metrics;
  PlayAhead play;
  // Looks for new volumes of series. Null if there are none. Set before shards.is_filled().
  std::unique_ptr<base::Executor> series_executor;
  // These come last, because their threads use the members above.
  base::ExecutorShare frame_executor;
  base::Executor extraction_executor;
  base::Executor query_executor;
  base::Executor label_executor;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_AGENT_CONTEXT_H_
