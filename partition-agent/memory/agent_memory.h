// Splits the memory limit of the agents of a process into fixed memory, memory of the steps in
// work, and caches.

#ifndef ISOSCOPE_PARTITION_AGENT_MEMORY_AGENT_MEMORY_H_
#define ISOSCOPE_PARTITION_AGENT_MEMORY_AGENT_MEMORY_H_

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/executor.h"
#include "core/base/memory_budget.h"
#include "core/base/mutex.h"
#include "core/base/task_arena.h"
#include "core/math/vec.h"
#include "core/render/layer_pass.h"
#include "core/view/camera.h"
#include "partition-agent/cache/block_cache.h"
#include "partition-agent/memory/frames_in_work.h"
#include "partition-agent/memory/idle_toucher.h"
#include "partition-agent/shard/series_shard.h"

namespace isoscope::agent {

// Thread-safe. Outlives the agents that use it.
class AgentMemory {
 public:
  // Returns a quarter of the memory that the process may use, at least 1 GiB.
  static std::size_t DefaultLimitBytes();
  static constexpr std::size_t kMinLimitBytes = std::size_t{96} << 20;

  // This many steps that each draw with all threads have room, whatever they draw.
  static constexpr int kDefaultStepCount = 2;

  // Returns the number of threads that draw with this limit: as many as are asked for (0: one for
  // each core), or as there is room for (ThreadBytes, blocks of the usual size), at least two.
  static int DrawingThreads(int thread_count, std::size_t limit_bytes);
  // Returns the arena of a process with this limit, of that number of threads. With a small limit
  // malloc keeps less of what is freed from then on.
  static std::shared_ptr<base::TaskArena> MakeArena(int thread_count, std::size_t limit_bytes);

  // step_count: steps that run at a time. With more than the default each may take less for meshes
  // and reads.
  // thread_count: of the arena
  // REQUIRES: limit_bytes >= kMinLimitBytes. The cache keeps nothing before Settle.
  explicit AgentMemory(std::size_t limit_bytes, int step_count = kDefaultStepCount,
                       int thread_count = 1);

  // A frame that is expected: its steps draw this. max_layers: as for ReserveStep.
  struct ExpectedStep {
    view::Viewport viewport;
    int max_layers = 0;
  };

  // Gives the cache the memory that neither the process holds nor frames need. With touches_ahead it
  // touches some of it now, and goes on while no frames are in work: that pays from the second frame
  // on. Call it once all shards are open. FAILED_PRECONDITION if no memory is left; the message has
  // the least limit that is enough, also for the expected step, and says if fewer threads would do.
  absl::Status Settle(const std::optional<ExpectedStep>& expected = std::nullopt,
                      bool touches_ahead = true);

  // Limits of a renderer: unused images and buffers, unused layers, and meshes whose pixels are not
  // shaded yet.
  [[nodiscard]] std::size_t unused_image_bytes() const { return limit_bytes_ / 16; }
  [[nodiscard]] std::size_t unused_layer_bytes() const { return limit_bytes_ / 32; }
  [[nodiscard]] std::size_t kept_mesh_bytes() const { return limit_bytes_ / (8 * step_count_); }

  // The open scalar volumes of all series. Whoever takes it before Settle has the cache leave room
  // for them.
  [[nodiscard]] std::shared_ptr<OpenVolumes> TakeOpenVolumes() {
    has_series_.store(true);
    return open_volumes_;
  }

  // The units of sources of index-only shards. NoteSource: there are some, so the cache leaves room
  // for them. Call it before Settle.
  [[nodiscard]] std::size_t source_bytes() const { return limit_bytes_ / kSourceShare; }
  // Of the indexes of their shards: room for those of a million chunks in a GiB.
  [[nodiscard]] std::size_t source_index_bytes() const { return limit_bytes_ / kSourceIndexShare; }
  void NoteSource() { has_source_.store(true); }
  // A shard has blocks of this size. Call it before Settle.
  void NoteBlocks(const math::Index3& block_cells);

  // Returns the most bytes of reads under way of a step, or of a batch of an export: a 32nd of the
  // limit with the default number of steps, at most 16 MiB (more does not pay), at least one disk
  // run.
  [[nodiscard]] std::size_t read_bytes() const;

  // Returns the least limit that has room for a step, in whole MiB.
  static std::size_t LeastLimitFor(const view::Viewport& viewport, int max_layers, int step_count);

  // Reserves the memory of one step, read_bytes() included. Waits for other steps.
  // RESOURCE_EXHAUSTED if the viewport is too large for the limit; the message has the least limit
  // that is enough.
  //
  // max_layers: FrameSpec::max_layers of a frame with translucent surfaces; 0 for others
  absl::StatusOr<base::MemoryBudget::Reservation> ReserveStep(
      const view::Viewport& viewport, const base::Cancellation& cancellation, int max_layers = 0);

  // Returns the number of steps of this kind that have room at a time.
  [[nodiscard]] std::size_t RoomFor(const view::Viewport& viewport, int max_layers) const;

  // Reserves the memory of reads alone, for work ahead of frames. Errors: of the cancellation.
  absl::StatusOr<base::MemoryBudget::Reservation> ReserveReads(
      const base::Cancellation& cancellation) {
    return steps_.Reserve(read_bytes(), cancellation);
  }
  // Returns the threads of the process for work ahead of frames, one each, made at the first call.
  struct AheadThreads {
    std::shared_ptr<base::Executor> reading;  // waits for the disk, computes little
    std::shared_ptr<base::Executor> making;   // waits for frames to end, then uses the arena
  };
  AheadThreads TakeAheadThreads() ABSL_LOCKS_EXCLUDED(ahead_mutex_);
  [[nodiscard]] FramesInWork* frames() { return &frames_; }
  [[nodiscard]] const OpenVolumes& open_volumes() const { return *open_volumes_; }

  [[nodiscard]] std::size_t limit_bytes() const { return limit_bytes_; }
  [[nodiscard]] BlockCache* cache() { return &cache_; }
  [[nodiscard]] render::LayerRenderer* layers() { return &layers_; }

 private:
  // Shares of the limit, if there are index-only shards.
  static constexpr std::size_t kSourceShare = 8;
  static constexpr std::size_t kSourceIndexShare = 64;

  [[nodiscard]] std::size_t StepBytes(const view::Viewport& viewport, int max_layers) const;
  // With another limit: the bytes of all threads of the arena, and of what frames and open volumes
  // take.
  [[nodiscard]] std::size_t ThreadBytes(std::size_t limit_bytes) const;
  [[nodiscard]] std::size_t ForFrames(std::size_t limit_bytes) const;

  const std::size_t limit_bytes_;
  const std::size_t step_count_;  // at least the default
  const std::size_t thread_count_;
  std::atomic<std::int64_t> block_samples_{0};  // of the largest block
  std::atomic<bool> has_series_{false};
  std::atomic<bool> has_source_{false};
  const std::shared_ptr<OpenVolumes> open_volumes_;
  base::MemoryBudget steps_;
  BlockCache cache_;
  render::LayerRenderer layers_;
  FramesInWork frames_;
  base::Mutex ahead_mutex_;
  AheadThreads ahead_threads_ ABSL_GUARDED_BY(ahead_mutex_);
  std::unique_ptr<IdleToucher> toucher_;  // last: its thread uses the members above
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_MEMORY_AGENT_MEMORY_H_
