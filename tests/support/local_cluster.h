// A coordinator and its agents in one process, without gRPC: agents are FramePipelines on threads
// of their own, joined to RunFrame by the same encodings as on the wire. What is kept between
// frames is kept here, too. For tests of the picture.

#ifndef ISOSCOPE_TESTS_SUPPORT_LOCAL_CLUSTER_H_
#define ISOSCOPE_TESTS_SUPPORT_LOCAL_CLUSTER_H_

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/task_arena.h"
#include "core/frame/frame_spec.h"
#include "core/image/frame_image.h"
#include "core/render/layer_pass.h"
#include "core/render/renderer.h"
#include "core/render/renderer_factory.h"
#include "core/store/sample_reader.h"
#include "core/store/series_manifest.h"
#include "core/volume/grid_geometry.h"
#include "partition-agent/cache/block_cache.h"
#include "partition-agent/shard/series_shard.h"
#include "partition-agent/shard/shard.h"
#include "server/frame/active_blocks.h"
#include "server/frame/frame_coordinator.h"
#include "tests/support/draws.h"

namespace isoscope::testing {

// Returns the grid of a level of the volume with this grid.
volume::GridGeometry GridOfLevel(const volume::GridGeometry& whole, int level);

// A cluster is awake or asleep. Only one of the process may be awake: each bounds the threads of
// the process, and TBB takes the least bound. Frames may be rendered side by side; all else is
// thread-compatible.
class LocalCluster {
 public:
  static constexpr std::size_t kAmpleCacheBytes = std::size_t{1} << 30;

  // Opens the dataset directory, and wakes the cluster: one agent for each shard, and one cache for
  // all of them. `renderer` must outlive it; null: the CPU draws, within the memory limit.
  static absl::StatusOr<std::unique_ptr<LocalCluster>> Open(
      const std::string& dataset_directory, render::Renderer* renderer, const Limits& limits,
      std::size_t cache_bytes = kAmpleCacheBytes);
  // Opens it asleep. open_samples: for an index-only dataset
  static absl::StatusOr<std::unique_ptr<LocalCluster>> OpenAsleep(
      const std::string& dataset_directory, render::Renderer* renderer,
      const store::OpenSamples& open_samples = nullptr);
  // The same of a series. The agents share `open_volume_bytes` for the scalar volumes that they
  // keep open.
  static absl::StatusOr<std::unique_ptr<LocalCluster>> OpenSeriesAsleep(
      const std::string& dataset_directory, render::Renderer* renderer,
      std::size_t open_volume_bytes, const store::OpenSamples& open_samples = nullptr);

  // Starts the threads. An error says that not all of them ran. REQUIRES: all clusters sleep.
  absl::Status Wake(const Limits& limits);
  // The same, in an arena of MakeOnlyArena that has limits.thread_count threads.
  void WakeIn(std::shared_ptr<base::TaskArena> arena, const Limits& limits);
  // Gives the threads back. What the agents keep stays. REQUIRES: no frame is in work.
  void Sleep();
  [[nodiscard]] const Limits& limits() const { return limits_; }

  [[nodiscard]] const store::Manifest& manifest() const {
    return shards_.front()->reader->manifest();
  }
  [[nodiscard]] const std::vector<std::shared_ptr<const agent::Shard>>& shards() const {
    return shards_;
  }

  [[nodiscard]] const agent::BlockCache& cache() const { return *cache_; }

  // Clears the caches of agents and coordinator; the agents get a new cache of `cache_bytes`.
  void ForgetAll(std::size_t cache_bytes);

  // Surfaces that show `field` have the samples of this dataset from now on, which is cut as the
  // cluster's. Does nothing if the field is known.
  absl::Status AddField(const std::string& field, const std::string& dataset_directory);

  // For a series, `field` is the volume of that field and component at the step of each frame.
  void AddField(const std::string& field, int field_index, int component) {
    series_fields_[field] = {.field = field_index, .component = component};
  }

  // From now on each part has two agents, and frames lose the first ones somewhere on the way.
  void LoseAgents() { loses_agents_ = true; }
  // From now on the coordinator culls by trees, as in volumes with too many blocks for a set of
  // them. Forgets active blocks.
  void CullByTrees();

  // Renders one frame through all steps. Of `request`, its number, what tells the
  // agents apart and report_active_blocks are set here. Its level is drawn: NOT_FOUND if a shard
  // lacks it. Isovalues and ranges are in field units at every level.
  absl::StatusOr<server::FrameResult> Render(const frame::FrameSpec& spec,
                                             const base::Cancellation& cancellation);
  absl::StatusOr<server::FrameResult> Render(const frame::FrameSpec& spec) {
    return Render(spec, base::Cancellation());
  }
  // Renders a frame of one scalar volume of a series.
  absl::StatusOr<server::FrameResult> Render(const frame::FrameSpec& spec,
                                             const store::ScalarVolumeKey& volume);

 private:
  // A level of a volume, by agent.
  struct Level {
    agent::Shards shards;
    double value_scale = 1;  // volume::VolumeLevel::value_scale
  };

  // NOT_FOUND if a shard lacks it.
  static absl::StatusOr<Level> LevelOf(const agent::Shards& shards, int level);
  // Opens a scalar volume on all agents.
  [[nodiscard]] absl::StatusOr<Level> OpenVolume(const store::ScalarVolumeKey& key,
                                                 int level) const;
  // `whole`: grid of level 0. `colors` by surface, empty where a surface shows no field.
  absl::StatusOr<server::FrameResult> RenderLevel(const frame::FrameSpec& spec,
                                                  const volume::GridGeometry& whole,
                                                  const Level& drawn,
                                                  const std::vector<Level>& colors,
                                                  const base::Cancellation& cancellation);

  agent::Shards shards_;                                     // empty if it is a series
  std::vector<std::unique_ptr<agent::SeriesShard>> series_;  // empty if it is none
  // By ColorBy::field.
  std::map<std::string, agent::Shards> fields_;
  std::map<std::string, store::ScalarVolumeKey> series_fields_;  // the step does not count
  render::Renderer* given_renderer_ = nullptr;
  Limits limits_;
  std::shared_ptr<base::TaskArena> arena_;  // null while the cluster sleeps, as the next two
  render::Renderer* renderer_ = nullptr;
  std::unique_ptr<render::Renderer> cpu_renderer_;  // also null if given_renderer_ is one
  std::unique_ptr<render::LayerRenderer> layers_;
  std::shared_ptr<image::FrameImagePool> images_;
  std::unique_ptr<agent::BlockCache> cache_;
  std::unique_ptr<server::ActiveBlocksCache> active_blocks_;
  std::atomic<std::int64_t> frame_count_{0};
  bool loses_agents_ = false;
  bool culls_by_trees_ = false;
};

// Makes the renderer that clusters of an OpenGL test share, with a limit drawn from `seed`: a
// context takes long to make. Null for the CPU, whose clusters have renderers of their own.
absl::StatusOr<std::unique_ptr<render::Renderer>> MakeSharedRenderer(render::RendererKind kind,
                                                                     std::uint64_t seed);

// The clusters of a test, each opened once. One of them at a time is awake. Thread-compatible.
class LocalClusters {
 public:
  // Draws threads and limits from `seed`. `renderer` is as for LocalCluster.
  LocalClusters(render::Renderer* renderer, std::uint64_t seed)
      : renderer_(renderer), dice_(seed) {}

  // Wakes the cluster of a dataset, with a new limit, and now and then with a new count of threads.
  // It sleeps at the next call.
  absl::StatusOr<LocalCluster*> Wake(const std::string& dataset_directory);

 private:
  // On a busy machine it takes long until all threads of an arena have run.
  static constexpr std::int64_t kWakesOfArena = 16;

  render::Renderer* const renderer_;
  Dice dice_;
  std::int64_t wake_count_ = 0;
  std::shared_ptr<base::TaskArena> arena_;
  std::map<std::string, std::unique_ptr<LocalCluster>> clusters_;
  LocalCluster* awake_ = nullptr;
};

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_LOCAL_CLUSTER_H_
