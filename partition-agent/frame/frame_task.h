// The task of one agent for one frame. No wire types.

#ifndef ISOSCOPE_PARTITION_AGENT_FRAME_FRAME_TASK_H_
#define ISOSCOPE_PARTITION_AGENT_FRAME_FRAME_TASK_H_

#include <cstdint>
#include <optional>
#include <vector>

#include "core/frame/frame_spec.h"
#include "core/volume/block_layout.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::agent {

struct FrameTask {
  std::int64_t frame_number = 0;  // the coordinator's
  // With its camera; isovalues and ranges are of stored values (frame::InStoredValues).
  frame::FrameSpec spec;
  // The grid of level 0 if shards of another level are drawn: the frame has its clip planes.
  std::optional<volume::GridGeometry> whole = std::nullopt;
  // The agent casts share agent_index of agent_count equal shares of the rays.
  int agent_index = 0;
  int agent_count = 1;
  bool report_active_blocks = true;
  // Ascending: the agent's blocks whose opaque meshes an earlier band of the picture has counted,
  // and those whose translucent meshes it has.
  std::vector<volume::BlockId> counted_blocks = {};
  std::vector<volume::BlockId> counted_layer_blocks = {};
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_FRAME_FRAME_TASK_H_
