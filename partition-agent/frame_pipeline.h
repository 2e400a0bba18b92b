// The three steps of one frame on one agent (docs/architecture.md, "Life of a frame"). No gRPC
// types: partition_agent_service_impl drives it from a stream, tests drive it directly.

#ifndef ISOSCOPE_PARTITION_AGENT_FRAME_PIPELINE_H_
#define ISOSCOPE_PARTITION_AGENT_FRAME_PIPELINE_H_

#include <cstdint>
#include <memory>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include <oneapi/tbb/task_arena.h>

#include "core/base/cancellation.h"
#include "core/image/frame_image.h"
#include "core/render/renderer.h"
#include "core/visibility/occlusion_map.h"
#include "core/volume/block_layout.h"
#include "partition-agent/frame_request.h"
#include "partition-agent/shard.h"

namespace isoscope::agent {

// What the agent's part took; the units and meanings of isoscope.v1.AgentStatistics.
struct AgentStatistics {
  std::int64_t active_block_count = 0;
  std::int64_t occluding_block_count = 0;
  std::int64_t visible_block_count = 0;
  std::int64_t triangle_count = 0;
  std::int64_t unique_vertex_count = 0;
  std::int64_t read_bytes = 0;
  std::int64_t index_page_read_count = 0;
  absl::Duration extract_duration;
  absl::Duration render_duration;
  absl::Duration busy_duration;
};

// Call the steps in order, each once, from one thread at a time; they block. After an error no
// further step may be called. Shards, renderer, arena and cancellation must outlive it.
//
//   kDepth, kMask: SelectOccluders, RenderOccluders, RenderVisible
//   kNone:         RenderAll
class FramePipeline {
 public:
  // All shards are of one dataset. INVALID_ARGUMENT if the request's camera or viewport is.
  static absl::StatusOr<std::unique_ptr<FramePipeline>> Make(
      std::vector<std::shared_ptr<const Shard>> shards, const FrameRequest& request,
      render::Renderer* renderer, tbb::task_arena* arena, const base::Cancellation* cancellation);
  ~FramePipeline();

  // Steps 0 and 1: queries the interval trees and casts the agent's share of the rays; returns the
  // blocks hit, ascending.
  absl::StatusOr<std::vector<volume::BlockId>> SelectOccluders();
  // Step 2: draws the agent's own blocks among the occluding ones. `hits`: the union over all
  // agents; the active neighbours are added here.
  absl::StatusOr<image::FrameImage> RenderOccluders(const std::vector<volume::BlockId>& hits);
  // Step 3: draws its other active blocks that the map does not hide. The image holds only
  // fragments that the map does not hide either.
  absl::StatusOr<image::FrameImage> RenderVisible(const visibility::OcclusionMap& map);
  // Draws every active block.
  absl::StatusOr<image::FrameImage> RenderAll();

  [[nodiscard]] const AgentStatistics& statistics() const;

 private:
  class Impl;
  explicit FramePipeline(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_FRAME_PIPELINE_H_
