// The resources that the frames and exports of an agent share. They outlive them.

#ifndef ISOSCOPE_PARTITION_AGENT_MEMORY_AGENT_RESOURCES_H_
#define ISOSCOPE_PARTITION_AGENT_MEMORY_AGENT_RESOURCES_H_

#include <cstddef>

#include "core/base/task_arena.h"
#include "core/base/trace_recorder.h"
#include "core/io/read_queue.h"
#include "core/render/layer_pass.h"
#include "core/render/renderer.h"
#include "partition-agent/cache/block_cache.h"
#include "partition-agent/memory/agent_metrics.h"
#include "partition-agent/memory/frames_in_work.h"

namespace isoscope::agent {

struct AgentResources {
  render::Renderer* renderer = nullptr;     // for frames; exports draw nothing
  render::LayerRenderer* layers = nullptr;  // for frames with translucent surfaces
  // For frames that only the CPU draws; null if `renderer` does that.
  render::Renderer* cpu_renderer = nullptr;
  base::TaskArena* arena = nullptr;
  BlockCache* cache = nullptr;
  std::size_t max_read_bytes = io::ReadQueueOptions().max_bytes;  // most bytes under way of a step
  base::TraceRecorder* trace = nullptr;                           // of one frame; null: no trace
  AgentMetrics* metrics = nullptr;                                // null: nothing is counted
  FramesInWork* frames = nullptr;  // learns of waits for the disk; null: nobody does
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_MEMORY_AGENT_RESOURCES_H_
