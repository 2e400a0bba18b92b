// A coordinator and its agents in one process, without gRPC: agents are FramePipelines on threads
// of their own, joined to RunFrame by the same encodings as on the wire. What is kept between
// frames is kept here, too. For tests of the picture.

#ifndef ISOSCOPE_TESTS_SUPPORT_LOCAL_CLUSTER_H_
#define ISOSCOPE_TESTS_SUPPORT_LOCAL_CLUSTER_H_

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include <oneapi/tbb/task_arena.h>

#include "core/base/cancellation.h"
#include "core/frame/frame_spec.h"
#include "core/image/frame_image.h"
#include "core/render/layer_pass.h"
#include "core/render/renderer.h"
#include "partition-agent/block_cache.h"
#include "partition-agent/shard.h"
#include "server/active_blocks.h"
#include "server/frame_coordinator.h"

namespace isoscope::testing {

// Frames may be rendered side by side; all else is thread-compatible.
class LocalCluster {
 public:
  static constexpr std::size_t kAmpleCacheBytes = std::size_t{1} << 30;
  static constexpr std::size_t kUnusedLayerBytes = std::size_t{16} << 20;

  // Opens the dataset directory; one agent for each shard, and one cache for all of them.
  // `renderer` must outlive it.
  static absl::StatusOr<std::unique_ptr<LocalCluster>> Open(
      const std::string& dataset_directory, render::Renderer* renderer, int thread_count,
      std::size_t cache_bytes = kAmpleCacheBytes);

  [[nodiscard]] const store::Manifest& manifest() const {
    return shards_.front()->reader->manifest();
  }
  [[nodiscard]] const std::vector<std::shared_ptr<const agent::Shard>>& shards() const {
    return shards_;
  }

  [[nodiscard]] const agent::BlockCache& cache() const { return *cache_; }

  // Agents and coordinator forget what they kept; the agents' cache is one of `cache_bytes` anew.
  void ForgetAll(std::size_t cache_bytes);

  // From now on each part has two agents, and frames lose the first ones somewhere on the way.
  void LoseAgents() { loses_agents_ = true; }

  // Renders one frame through all steps. Of `request`, its number, what tells the
  // agents apart and report_active_blocks are set here.
  absl::StatusOr<server::FrameResult> Render(const frame::FrameSpec& spec,
                                             const base::Cancellation& cancellation);
  absl::StatusOr<server::FrameResult> Render(const frame::FrameSpec& spec) {
    return Render(spec, base::Cancellation());
  }

 private:
  std::vector<std::shared_ptr<const agent::Shard>> shards_;
  render::Renderer* renderer_ = nullptr;
  std::unique_ptr<render::Renderer> cpu_renderer_;  // null if renderer_ is one
  render::LayerRenderer layers_{kUnusedLayerBytes};
  std::unique_ptr<tbb::task_arena> arena_;
  std::unique_ptr<agent::BlockCache> cache_;
  std::unique_ptr<server::ActiveBlocksCache> active_blocks_;
  std::shared_ptr<image::FrameImagePool> images_;
  std::atomic<std::int64_t> frame_count_{0};
  bool loses_agents_ = false;
};

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_LOCAL_CLUSTER_H_
