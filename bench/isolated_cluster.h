// A coordinator and its agents in this process. The agents work one after the other, each alone on
// one thread. So each takes as long as on its own machine, whatever the number of cores here.
// Pipeline, reduces and encodings are those of a real cluster, without gRPC.

#ifndef ISOSCOPE_BENCH_ISOLATED_CLUSTER_H_
#define ISOSCOPE_BENCH_ISOLATED_CLUSTER_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/memory_pool.h"
#include "core/base/task_arena.h"
#include "core/frame/frame_spec.h"
#include "core/image/frame_image.h"
#include "core/render/renderer.h"
#include "core/store/manifest.h"
#include "core/volume/block_layout.h"
#include "partition-agent/frame/frame_task.h"
#include "partition-agent/shard/shard.h"

namespace isoscope::bench {

// One agent's share of a frame.
struct IsolatedAgent {
  std::int64_t active_block_count = 0;
  std::int64_t drawn_block_count = 0;
  std::int64_t triangle_count = 0;
  double busy_ms = 0;  // as in isoscope.v1.AgentStatistics
};

struct IsolatedFrame {
  image::FrameImage image;
  std::vector<IsolatedAgent> agents;  // by shard
  // The blocks of each step, ascending; empty without culling.
  std::vector<volume::BlockId> ray_hits;
  std::vector<volume::BlockId> occluding;  // with ray_hits
  std::vector<volume::BlockId> drawn;      // with occluding
  // All time outside of the agents: decoding pixels, reduces, the test of blocks.
  double other_ms = 0;

  [[nodiscard]] std::int64_t active_block_count() const;
  [[nodiscard]] std::int64_t drawn_block_count() const;
  [[nodiscard]] std::int64_t triangle_count() const;
  [[nodiscard]] std::vector<double> busy_ms() const;  // by shard
};

// A picture of some blocks.
struct BlocksPicture {
  image::FrameImage image;
  std::int64_t triangle_count = 0;
};

// Thread-compatible; everything runs on the calling thread.
class IsolatedCluster {
 public:
  // Opens a whole dataset directory; one agent for each shard. `renderer` must outlive it. Errors
  // as store::OpenDataset and agent::OpenShard.
  static absl::StatusOr<std::unique_ptr<IsolatedCluster>> Open(const std::string& dataset_directory,
                                                               render::Renderer* renderer);

  [[nodiscard]] const store::Manifest& manifest() const {
    return shards_.front()->reader->manifest();
  }
  // The order of the fragments in its pictures.
  [[nodiscard]] image::FragmentOrder fragment_order() const {
    return {.block_count = static_cast<std::uint32_t>(layout().block_count()),
            .ties = frame::TieRuleOf(renderer_->picture_revision().back_end)};
  }
  [[nodiscard]] const volume::BlockLayout& layout() const {
    return shards_.front()->reader->layout();
  }

  // Returns all active blocks of the volume, ascending.
  [[nodiscard]] std::vector<volume::BlockId> ActiveBlocks(double isovalue) const {
    return shards_.front()->reader->ranges().ActiveBlocks(isovalue).Ids();
  }

  // Renders one frame with empty block and mesh caches, and the files in the page cache. Sets
  // agent_index and agent_count of the request. Errors as server::RunFrame.
  absl::StatusOr<IsolatedFrame> Render(const frame::FrameSpec& spec,
                                       const base::Cancellation& cancellation);

  // Draws exactly `blocks`, which are ascending and active at the request's isovalue.
  absl::StatusOr<BlocksPicture> DrawBlocks(const frame::FrameSpec& spec,
                                           const std::vector<volume::BlockId>& blocks,
                                           const base::Cancellation& cancellation);

  // Returns the triangles of each block that has any, as frames count them. In no order.
  absl::StatusOr<std::vector<std::int64_t>> TriangleCounts(double isovalue,
                                                           const base::Cancellation& cancellation);

 private:
  IsolatedCluster() : arena_(1) {}

  [[nodiscard]] agent::FrameTask TaskOf(const frame::FrameSpec& spec,
                                        std::size_t agent_index) const;

  static constexpr std::size_t kUnusedImageBytes = std::size_t{64} << 20;

  std::vector<std::shared_ptr<const agent::Shard>> shards_;
  // By shard, for meshes: real agents have allocated it before their first frame.
  std::vector<std::shared_ptr<base::MemoryPool>> mesh_memory_;
  const std::shared_ptr<image::FrameImagePool> images_ =
      image::FrameImagePool::Make(kUnusedImageBytes);
  render::Renderer* renderer_ = nullptr;
  base::TaskArena arena_;
};

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_ISOLATED_CLUSTER_H_
