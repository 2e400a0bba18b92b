// The resources that the frames and exports of an agent share. They outlive them.

#ifndef ISOSCOPE_PARTITION_AGENT_AGENT_RESOURCES_H_
#define ISOSCOPE_PARTITION_AGENT_AGENT_RESOURCES_H_

#include <cstddef>

#include <oneapi/tbb/task_arena.h>

#include "core/base/trace_recorder.h"
#include "core/io/read_queue.h"
#include "core/render/layer_pass.h"
#include "core/render/renderer.h"
#include "partition-agent/agent_metrics.h"
#include "partition-agent/block_cache.h"

namespace isoscope::agent {

struct AgentResources {
  render::Renderer* renderer = nullptr;     // of frames; exports draw nothing
  render::LayerRenderer* layers = nullptr;  // of frames with translucent surfaces
  // Of frames that only the CPU draws; null if `renderer` does that.
  render::Renderer* cpu_renderer = nullptr;
  tbb::task_arena* arena = nullptr;
  BlockCache* cache = nullptr;
  std::size_t max_read_bytes = io::ReadQueueOptions().max_bytes;  // of each step, under way
  base::TraceRecorder* trace = nullptr;                           // of one frame; null: it has none
  AgentMetrics* metrics = nullptr;                                // null: nobody counts
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_AGENT_RESOURCES_H_
