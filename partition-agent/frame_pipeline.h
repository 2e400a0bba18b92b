// The three steps of one frame on one agent (docs/architecture.md, "Life of a frame"). No gRPC
// types: partition_agent_service_impl drives it from a stream, tests drive it directly.

#ifndef ISOSCOPE_PARTITION_AGENT_FRAME_PIPELINE_H_
#define ISOSCOPE_PARTITION_AGENT_FRAME_PIPELINE_H_

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include <oneapi/tbb/task_arena.h>

#include "core/base/cancellation.h"
#include "core/frame/agent_statistics.h"
#include "core/image/frame_image.h"
#include "core/io/read_queue.h"
#include "core/render/renderer.h"
#include "core/volume/block_layout.h"
#include "partition-agent/block_cache.h"
#include "partition-agent/frame_request.h"
#include "partition-agent/shard.h"

namespace isoscope::agent {

// What step 1 finds.
struct RaySelection {
  std::vector<volume::BlockId> hits;    // blocks of any agent, ascending
  std::vector<volume::BlockId> active;  // the agent's own active blocks, ascending; if asked for
};

// What the frames of an agent share; it outlives them.
struct AgentResources {
  render::Renderer* renderer = nullptr;
  tbb::task_arena* arena = nullptr;
  BlockCache* cache = nullptr;
  std::size_t max_read_bytes = io::ReadQueueOptions().max_bytes;  // of each step, under way
};

// Call the steps in order, each once, from one thread at a time; they block. After an error no
// further step may be called. Cancellation must outlive it.
//
//   kDepth, kMask: SelectOccluders, RenderOccluders, RenderVisible
//   kNone:         RenderAll
class FramePipeline {
 public:
  // All shards are of one dataset. INVALID_ARGUMENT if the request's camera or viewport is.
  static absl::StatusOr<std::unique_ptr<FramePipeline>> Make(
      std::vector<std::shared_ptr<const Shard>> shards, const FrameRequest& request,
      const AgentResources& resources, const base::Cancellation* cancellation);
  ~FramePipeline();

  // Steps 0 and 1: queries the interval trees and casts the agent's share of the rays.
  absl::StatusOr<RaySelection> SelectOccluders();
  // Step 2: draws `blocks`, ascending: the agent's own occluding blocks. INVALID_ARGUMENT if one is
  // not an active block of its.
  absl::StatusOr<image::FrameImage> RenderOccluders(const std::vector<volume::BlockId>& blocks);
  // Step 3: draws `blocks`, ascending: the agent's own other blocks that the occluders do not hide.
  // `open_pixels`: visibility::EncodeOpenPixels of those they could win; empty: all.
  // INVALID_ARGUMENT as above; DATA_LOSS if open_pixels is damaged or does not fit the blocks.
  absl::StatusOr<image::FrameImage> RenderVisible(const std::vector<volume::BlockId>& blocks,
                                                  absl::string_view open_pixels);
  // Draws every active block.
  absl::StatusOr<image::FrameImage> RenderAll();
  // What a step drew as bands (composite::EncodePixels), after that step.
  std::vector<std::string> Encode(const image::FrameImage& image);

  [[nodiscard]] const frame::AgentStatistics& statistics() const;

 private:
  class Impl;
  explicit FramePipeline(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_FRAME_PIPELINE_H_
