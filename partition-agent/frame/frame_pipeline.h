// The three steps of one frame on one agent (docs/architecture.md, "Life of a frame"). No gRPC
// types: partition_agent_service_impl drives it from a stream, tests drive it directly.

#ifndef ISOSCOPE_PARTITION_AGENT_FRAME_FRAME_PIPELINE_H_
#define ISOSCOPE_PARTITION_AGENT_FRAME_FRAME_PIPELINE_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/base/cancellation.h"
#include "core/frame/agent_statistics.h"
#include "core/image/frame_image.h"
#include "core/image/layer_stack.h"
#include "core/image/pixel_mask.h"
#include "core/view/clip_region.h"
#include "core/view/view.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_set.h"
#include "partition-agent/frame/frame_task.h"
#include "partition-agent/memory/agent_resources.h"
#include "partition-agent/shard/shard.h"
#include "partition-agent/supply/color_volumes.h"
#include "partition-agent/supply/mesh_supply.h"
#include "partition-agent/supply/surface_blocks.h"

namespace isoscope::agent {

// The result of step 1.
struct RaySelection {
  std::vector<volume::BlockId> hits;    // blocks of any agent, ascending
  std::vector<volume::BlockId> active;  // own active blocks, ascending; if asked for
};

// Call the steps in order, each once, from one thread at a time. They block. A step out of order
// ends the process. Call no step after an error. The cancellation must outlive the pipeline.
// RESOURCE_EXHAUSTED if memory runs out in a step: the frame fails, others continue.
//
//   kDepth, kMask: SelectOccluders, RenderOccluders, RenderVisible
//   kNone:         RenderAll
class FramePipeline {
 public:
  // All shards are of one dataset. INVALID_ARGUMENT if the camera or the range of caps with a map
  // is not set, or camera or viewport do not validate, or surfaces times blocks are too many
  // (frame::CheckOwners), or a surface shows a field and has no shards in `color_shards`.
  // FAILED_PRECONDITION as ColorVolumes::Make.
  //
  // color_shards: as ColorVolumes::Make takes them. They are read if pixels carry steps.
  static absl::StatusOr<std::unique_ptr<FramePipeline>> Make(
      Shards shards, const FrameTask& task, const AgentResources& resources,
      const base::Cancellation* cancellation, const std::vector<Shards>& color_shards = {});

  // Steps 0 and 1: queries the interval trees and casts the agent's share of the rays.
  absl::StatusOr<RaySelection> SelectOccluders();
  // Step 2: draws `blocks`, ascending: the agent's own occluding blocks. INVALID_ARGUMENT if one of
  // them is not an active block of the agent.
  absl::StatusOr<image::FrameImage> RenderOccluders(const std::vector<volume::BlockId>& blocks);
  // Step 3: draws `blocks`, ascending: the agent's own blocks that the occluders do not hide,
  // without those of step 2. If a surface is translucent, they include the occluding blocks: step 2
  // draws opaque surfaces alone. `open_pixels`: visibility::EncodeOpenPixels of the pixels that
  // each block could win; empty: all. INVALID_ARGUMENT as above; DATA_LOSS if open_pixels is
  // damaged or does not fit the blocks.
  absl::StatusOr<image::FrameImage> RenderVisible(const std::vector<volume::BlockId>& blocks,
                                                  absl::string_view open_pixels);
  // Draws every active block.
  absl::StatusOr<image::FrameImage> RenderAll();
  // Encodes the image of a step and its layers as bands (composite::EncodePixels, EncodeLayers).
  // Call it after that step. It throws std::bad_alloc if memory runs out, and so may Make.
  std::vector<std::string> Encode(const image::FrameImage& image);
  // Returns the translucent fragments that the last step drew. Afterwards Encode has none.
  image::LayerStack TakeLayers() { return std::exchange(layers_, {}); }

  [[nodiscard]] const frame::AgentStatistics& statistics() const { return statistics_; }
  [[nodiscard]] std::uint64_t cache_round() const { return cache_round_; }
  // Returns the active blocks that are not among `drawn`. REQUIRES: step 0 is done.
  [[nodiscard]] std::vector<volume::BlockId> HiddenBlocks(const volume::BlockSet& drawn) const;

 private:
  // The next step that may be called. kFirst: SelectOccluders or RenderAll.
  enum class Step { kFirst, kRenderOccluders, kRenderVisible, kNone };

  FramePipeline(Shards shards, ColorVolumes colors, const FrameTask& task, const view::View& view,
                const AgentResources& resources, const base::Cancellation* cancellation);

  template <typename Work>
  std::invoke_result_t<Work> RunStep(const char* name, Step step, Step next, const Work& work);
  absl::Status FindBlocksWhile(const std::function<void()>& work);
  absl::Status FindBlocks();
  absl::StatusOr<std::vector<ChosenMesh>> ChooseVisible(const std::vector<volume::BlockId>& blocks,
                                                        const std::vector<image::PixelMask>& masks,
                                                        std::size_t* new_count) const;
  void LeaveOutCounted(std::vector<ChosenMesh>* chosen) const;
  absl::StatusOr<image::FrameImage> Draw(const std::vector<ChosenMesh>& chosen,
                                         std::size_t block_count);
  absl::StatusOr<image::FrameImage> DrawWithCaps(const std::vector<ChosenMesh>& chosen,
                                                 std::size_t block_count,
                                                 frame::Culling cap_culling);

  const Shards shards_;
  const ColorVolumes colors_;
  const FrameTask task_;
  const view::View view_;
  const volume::BlockLayout layout_;
  const view::Clipper clipper_;
  const AgentResources resources_;
  const base::Cancellation& cancellation_;
  const std::uint64_t cache_round_;
  Step next_step_ = Step::kFirst;

  std::unique_ptr<const SurfaceBlocks> blocks_;  // from step 0 on
  std::unique_ptr<MeshSupply> supply_;
  std::vector<volume::BlockId> reported_;   // active blocks, if they were asked for
  std::vector<volume::BlockId> occluding_;  // the blocks of step 2, if the frame has layers
  image::LayerStack layers_;                // of the last step
  frame::AgentStatistics statistics_;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_FRAME_FRAME_PIPELINE_H_
