// Reads one step of a play before its frame asks for it: samples into the system's memory, meshes
// into the mesh cache. Nothing that a frame does depends on it but its duration.

#ifndef ISOSCOPE_PARTITION_AGENT_PLAY_STEP_AHEAD_H_
#define ISOSCOPE_PARTITION_AGENT_PLAY_STEP_AHEAD_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/io/read_queue.h"
#include "core/view/clip_region.h"
#include "core/volume/block_layout.h"
#include "core/volume/inside_rule.h"
#include "partition-agent/memory/agent_resources.h"
#include "partition-agent/memory/frames_in_work.h"
#include "partition-agent/shard/shard.h"
#include "partition-agent/supply/color_volumes.h"
#include "partition-agent/supply/mesh_supply.h"
#include "partition-agent/supply/surface_blocks.h"

namespace isoscope::agent {

// The frame that is expected.
struct ExpectedFrame {
  Shards shards;  // of the step's volume
  ColorVolumes colors;
  std::vector<volume::InsideRule> rules;  // by surface
  std::vector<bool> with_magnitudes;      // by surface
  view::ClipRegion clip;
  std::vector<volume::BlockId> hidden;  // blocks that it will most likely not draw
  std::uint64_t cache_round = 0;        // of the frame before
};

// For one thread. The resources and the cancellation outlive it.
class StepAhead {
 public:
  // Finds the blocks that the frame needs. Errors as SurfaceBlocks::Find. Blocks on the disk.
  static absl::StatusOr<std::unique_ptr<StepAhead>> Make(const ExpectedFrame& frame,
                                                         const AgentResources& resources,
                                                         const base::Cancellation* cancellation);

  // Has the system read the samples whose meshes are not cached; a few MiB at a time, none while a
  // frame waits for the disk. Takes no memory of the agent's. Errors: of the cancellation; of the
  // disk. Blocks.
  absl::Status ReadSamples(FramesInWork* frames) const;

  // Extracts the meshes that are not cached into the cache. RESOURCE_EXHAUSTED once there is no
  // more room for meshes: those of the last three frames stay. Else errors as
  // MeshSupply::AddMeshes. Uses the arena. Blocks.
  absl::Status MakeMeshes();

 private:
  StepAhead(const ExpectedFrame& frame, SurfaceBlocks blocks, const AgentResources& resources,
            const base::Cancellation* cancellation);
  // The reads of the blocks of `meshes`, and of the samples that colour them.
  [[nodiscard]] std::vector<io::FileRead> ReadsOf(const std::vector<ChosenMesh>& meshes) const;

  const AgentResources resources_;
  const base::Cancellation& cancellation_;
  const ColorVolumes colors_;
  const SurfaceBlocks blocks_;
  std::vector<ChosenMesh> missing_;
  MeshSupply supply_;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_PLAY_STEP_AHEAD_H_
