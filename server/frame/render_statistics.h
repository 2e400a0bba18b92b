// The cost of a frame: measured in core types, converted for clients last.

#ifndef ISOSCOPE_SERVER_FRAME_RENDER_STATISTICS_H_
#define ISOSCOPE_SERVER_FRAME_RENDER_STATISTICS_H_

#include <cstdint>
#include <optional>
#include <vector>

#include "absl/time/time.h"

#include "core/frame/agent_statistics.h"
#include "isoscope/v1/frame.pb.h"
#include "server/frame/frame_coordinator.h"

namespace isoscope::server {

// Units and meanings are those of isoscope.v1.RenderStatistics.
struct FrameCost {
  frame::AgentStatistics total;  // the sum of counts, bytes and surfaces over the agents
  std::vector<frame::AgentStatistics> agents;
  std::int64_t ray_hit_block_count = 0;
  std::int64_t network_bytes = 0;
  std::int64_t png_bytes = 0;
  std::int64_t truncated_pixel_count = 0;
  absl::Duration occluder_selection;
  absl::Duration occluder_rendering;
  absl::Duration visibility_culling;
  absl::Duration composite;
  std::optional<absl::Duration> encode;  // not set: nothing was encoded
  std::vector<int> missing_shards;
  std::optional<double> active_block_coverage;
  int band_count = 1;                                  // 1: drawn at once
  std::optional<std::int64_t> unresolved_block_count;  // not set: level 0, or not counted
};

// Takes what the agents and the steps of a frame have cost.
FrameCost CostOf(const FrameResult& result);

// Adds the cost of another band of the same parts: bytes, times, pixels, triangles and vertices.
// Active blocks are the same in all bands; DrawnBlocks counts the others.
//
// has_surface: false: its triangles and vertices were counted already
void AddBand(const FrameCost& band, bool has_surface, FrameCost* cost);

isoscope::v1::RenderStatistics ToProto(const FrameCost& cost);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_RENDER_STATISTICS_H_
