#include "partition-agent/frame_pipeline.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <optional>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_format.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/clock.h"
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/extract/block_extractor.h"
#include "core/mesh/block_mesh.h"
#include "core/view/view.h"
#include "core/visibility/occluder_selection.h"
#include "core/volume/range_table.h"

namespace isoscope::agent {
namespace {

// Rays one task casts: some hundred microseconds.
constexpr std::int64_t kRaysPerTask = 512;

// An active block of this agent.
struct OwnBlock {
  volume::BlockId block_id = 0;
  std::uint32_t ordinal = 0;
};

// The first error of tasks that run side by side; the others stop when they see it.
class FirstError {
 public:
  [[nodiscard]] bool has_error() const { return has_error_.load(std::memory_order_relaxed); }
  void Set(absl::Status status) {
    absl::MutexLock lock(&mutex_);
    if (status_.ok()) {
      status_ = std::move(status);
      has_error_.store(true, std::memory_order_relaxed);
    }
  }
  absl::Status status() {
    absl::MutexLock lock(&mutex_);
    return status_;
  }

 private:
  std::atomic<bool> has_error_{false};
  absl::Mutex mutex_;
  absl::Status status_ ABSL_GUARDED_BY(mutex_);
};

// What one thread keeps between the runs it extracts.
struct Worker {
  Worker(const volume::GridGeometry& geometry, const volume::BlockLayout& layout)
      : extractor(geometry, layout) {}

  extract::BlockExtractor extractor;
  std::string buffer;
  std::int64_t triangle_count = 0;
  std::int64_t unique_vertex_count = 0;
  std::int64_t read_bytes = 0;
  absl::Duration extract_time;
  absl::Duration add_time;
};

// Adds the wall time of its own life.
class ScopedTimer {
 public:
  explicit ScopedTimer(absl::Duration* sum) : sum_(sum), start_(absl::Now()) {}
  ~ScopedTimer() { *sum_ += absl::Now() - start_; }
  ScopedTimer(const ScopedTimer&) = delete;
  ScopedTimer& operator=(const ScopedTimer&) = delete;

 private:
  absl::Duration* sum_;
  absl::Time start_;
};

}  // namespace

class FramePipeline::Impl {
 public:
  Impl(std::vector<std::shared_ptr<const Shard>> shards, const FrameRequest& request,
       const view::View& view, render::Renderer* renderer, tbb::task_arena* arena,
       const base::Cancellation* cancellation)
      : shards_(std::move(shards)),
        request_(request),
        view_(view),
        layout_(shards_.front()->reader->layout()),
        quantizer_(view_),
        renderer_(renderer),
        arena_(arena),
        cancellation_(cancellation) {}

  absl::StatusOr<std::vector<volume::BlockId>> SelectOccluders() {
    const ScopedTimer timer(&statistics_.busy_duration);
    ISOSCOPE_RETURN_IF_ERROR(FindOwnActiveBlocks());
    active_ = shards_.front()->reader->ranges().ActiveBlocks(request_.isovalue);

    const visibility::RaySet rays(view_, layout_, request_.ray_seed);
    const visibility::RayShare share =
        visibility::ShareOfRays(rays.count(), request_.agent_index, request_.agent_count);
    const std::int64_t task_count = (share.end - share.begin + kRaysPerTask - 1) / kRaysPerTask;
    std::vector<std::vector<volume::BlockId>> hits_by_task(static_cast<std::size_t>(task_count));
    arena_->execute([&] {
      tbb::parallel_for(std::int64_t{0}, task_count, [&](std::int64_t task) {
        if (cancellation_->is_cancelled()) {
          return;
        }
        const std::int64_t begin = share.begin + task * kRaysPerTask;
        hits_by_task[static_cast<std::size_t>(task)] =
            rays.Cast(begin, std::min(begin + kRaysPerTask, share.end), active_);
      });
    });
    ISOSCOPE_RETURN_IF_ERROR(cancellation_->Check());
    std::vector<volume::BlockId> hits;
    for (const std::vector<volume::BlockId>& task_hits : hits_by_task) {
      hits.insert(hits.end(), task_hits.begin(), task_hits.end());
    }
    std::sort(hits.begin(), hits.end());
    hits.erase(std::unique(hits.begin(), hits.end()), hits.end());
    return hits;
  }

  absl::StatusOr<image::FrameImage> RenderOccluders(const std::vector<volume::BlockId>& hits) {
    const ScopedTimer timer(&statistics_.busy_duration);
    occluding_ = visibility::OccludingBlocks(hits, layout_, active_);
    std::vector<std::vector<OwnBlock>> chosen(shards_.size());
    for (std::size_t shard = 0; shard < shards_.size(); ++shard) {
      for (const OwnBlock& block : own_active_[shard]) {
        if (occluding_.Contains(block.block_id)) {
          ++statistics_.occluding_block_count;
          if (!view_.FootprintOf(layout_, block.block_id).rect.empty()) {
            chosen[shard].push_back(block);
          }
        }
      }
    }
    return Draw(chosen);
  }

  absl::StatusOr<image::FrameImage> RenderVisible(const visibility::OcclusionMap& map) {
    const ScopedTimer timer(&statistics_.busy_duration);
    std::vector<std::vector<OwnBlock>> chosen(shards_.size());
    for (std::size_t shard = 0; shard < shards_.size(); ++shard) {
      for (const OwnBlock& block : own_active_[shard]) {
        if (occluding_.Contains(block.block_id)) {
          continue;
        }
        const view::Footprint footprint = view_.FootprintOf(layout_, block.block_id);
        if (!footprint.rect.empty() && !map.Hides(footprint, quantizer_)) {
          chosen[shard].push_back(block);
        }
      }
    }
    ISOSCOPE_ASSIGN_OR_RETURN(image::FrameImage image, Draw(chosen));
    DropHiddenFragments(map, &image);
    return image;
  }

  absl::StatusOr<image::FrameImage> RenderAll() {
    const ScopedTimer timer(&statistics_.busy_duration);
    ISOSCOPE_RETURN_IF_ERROR(FindOwnActiveBlocks());
    return Draw(own_active_);
  }

  [[nodiscard]] const AgentStatistics& statistics() const { return statistics_; }

 private:
  absl::Status FindOwnActiveBlocks() {
    own_active_.assign(shards_.size(), {});
    for (std::size_t shard = 0; shard < shards_.size(); ++shard) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation_->Check());
      ISOSCOPE_ASSIGN_OR_RETURN(const index::QueryResult result,
                                shards_[shard]->tree->Query(request_.isovalue));
      statistics_.index_page_read_count += result.page_read_count;
      statistics_.read_bytes += result.read_bytes;
      const store::ShardReader& reader = *shards_[shard]->reader;
      own_active_[shard].reserve(result.active.size());
      for (const index::BlockInterval& interval : result.active) {
        if (interval.ordinal >= reader.block_count() ||
            interval.block_id >= layout_.block_count()) {
          return absl::DataLossError(absl::StrFormat(
              "%s: the interval tree names block %d at place %d, the shard holds %d of %d blocks",
              reader.directory(), interval.block_id, interval.ordinal, reader.block_count(),
              layout_.block_count()));
        }
        own_active_[shard].push_back({interval.block_id, interval.ordinal});
      }
      statistics_.active_block_count += static_cast<std::int64_t>(result.active.size());
    }
    return absl::OkStatus();
  }

  // Reads, extracts and draws blocks; blocks[shard] is ascending by ordinal.
  absl::StatusOr<image::FrameImage> Draw(const std::vector<std::vector<OwnBlock>>& blocks) {
    ISOSCOPE_RETURN_IF_ERROR(cancellation_->Check());
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<render::RenderPass> pass,
                              renderer_->BeginPass(view_, layout_, request_.appearance));
    const absl::Time start = absl::Now();
    tbb::enumerable_thread_specific<Worker> workers(view_.geometry(), layout_);
    FirstError error;
    for (std::size_t shard = 0; shard < shards_.size(); ++shard) {
      ExtractShard(*shards_[shard]->reader, blocks[shard], pass.get(), &workers, &error);
    }
    const absl::Duration extract_wall = absl::Now() - start;
    ISOSCOPE_RETURN_IF_ERROR(error.status());

    absl::Duration extract_time;
    absl::Duration add_time;
    for (const Worker& worker : workers) {
      statistics_.triangle_count += worker.triangle_count;
      statistics_.unique_vertex_count += worker.unique_vertex_count;
      statistics_.read_bytes += worker.read_bytes;
      extract_time += worker.extract_time;
      add_time += worker.add_time;
    }
    // Threads extract and draw in turn: the wall time is shared out by what they spent on each.
    const absl::Duration total = extract_time + add_time;
    const double add_share =
        total > absl::ZeroDuration() ? absl::FDivDuration(add_time, total) : 0.0;
    statistics_.extract_duration += extract_wall * (1.0 - add_share);
    statistics_.render_duration += extract_wall * add_share;

    const ScopedTimer timer(&statistics_.render_duration);
    return pass->Finish(*cancellation_);
  }

  void ExtractShard(const store::ShardReader& reader, const std::vector<OwnBlock>& blocks,
                    render::RenderPass* pass, tbb::enumerable_thread_specific<Worker>* workers,
                    FirstError* error) {
    statistics_.visible_block_count += static_cast<std::int64_t>(blocks.size());
    std::vector<std::uint32_t> ordinals;
    ordinals.reserve(blocks.size());
    for (const OwnBlock& block : blocks) {
      ordinals.push_back(block.ordinal);
    }
    const std::vector<store::ShardReader::Run> runs = reader.PlanRuns(ordinals);
    arena_->execute([&] {
      tbb::parallel_for(std::size_t{0}, runs.size(), [&](std::size_t run_index) {
        if (error->has_error()) {
          return;
        }
        const store::ShardReader::Run& run = runs[run_index];
        Worker& worker = workers->local();
        const ScopedTimer timer(&worker.extract_time);
        const absl::Duration add_time_before = worker.add_time;
        std::size_t next = run.first;
        const absl::Status status =
            reader.ReadRun(run, ordinals, &worker.buffer, [&](const volume::BlockSamples& samples) {
              const OwnBlock& expected = blocks[next++];
              if (samples.block_id != expected.block_id) {
                return absl::DataLossError(absl::StrFormat(
                    "%s: the interval tree has block %d at place %d, the block index block %d",
                    reader.directory(), expected.block_id, expected.ordinal, samples.block_id));
              }
              return ExtractBlock(samples, pass, &worker);
            });
        worker.read_bytes += run.size;
        worker.extract_time -= worker.add_time - add_time_before;
        if (!status.ok()) {
          error->Set(status);
        }
      });
    });
  }

  absl::Status ExtractBlock(const volume::BlockSamples& samples, render::RenderPass* pass,
                            Worker* worker) const {
    ISOSCOPE_RETURN_IF_ERROR(cancellation_->Check());
    auto mesh = std::make_shared<mesh::BlockMesh>();
    worker->extractor.Extract(samples, request_.isovalue, {}, mesh.get());
    worker->triangle_count += mesh->triangle_count();
    worker->unique_vertex_count += mesh->owned_vertex_count;
    const ScopedTimer timer(&worker->add_time);
    return pass->Add(std::move(mesh));
  }

  // What lies behind the occluders has lost already and need not travel.
  void DropHiddenFragments(const visibility::OcclusionMap& map, image::FrameImage* image) const {
    for (int y = 0; y < image->height; ++y) {
      const std::size_t row = static_cast<std::size_t>(y) * static_cast<std::size_t>(image->width);
      for (int x = 0; x < image->width; ++x) {
        const std::size_t pixel = row + static_cast<std::size_t>(x);
        if (image->block_id[pixel] != image::kNoBlock &&
            map.HidesFragment(x, y, image->depth[pixel], quantizer_)) {
          image->depth[pixel] = image::kFarDepth;
          image->block_id[pixel] = image::kNoBlock;
          image->color[pixel] = {};
        }
      }
    }
  }

  const std::vector<std::shared_ptr<const Shard>> shards_;
  const FrameRequest request_;
  const view::View view_;
  const volume::BlockLayout layout_;
  const visibility::DepthQuantizer quantizer_;
  render::Renderer* const renderer_;
  tbb::task_arena* const arena_;
  const base::Cancellation* const cancellation_;

  volume::BlockSet active_;                        // of the whole volume
  volume::BlockSet occluding_;                     // of the whole volume
  std::vector<std::vector<OwnBlock>> own_active_;  // by shard, ascending by ordinal
  AgentStatistics statistics_;
};

absl::StatusOr<std::unique_ptr<FramePipeline>> FramePipeline::Make(
    std::vector<std::shared_ptr<const Shard>> shards, const FrameRequest& request,
    render::Renderer* renderer, tbb::task_arena* arena, const base::Cancellation* cancellation) {
  ISOSCOPE_CHECK(!shards.empty());
  for (const std::shared_ptr<const Shard>& shard : shards) {
    ISOSCOPE_CHECK_EQ(shard->reader->manifest().dataset_id,
                      shards.front()->reader->manifest().dataset_id);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const view::View view,
                            view::View::Make(request.camera, request.viewport,
                                             shards.front()->reader->manifest().geometry));
  return std::unique_ptr<FramePipeline>(new FramePipeline(
      std::make_unique<Impl>(std::move(shards), request, view, renderer, arena, cancellation)));
}

FramePipeline::FramePipeline(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
FramePipeline::~FramePipeline() = default;

absl::StatusOr<std::vector<volume::BlockId>> FramePipeline::SelectOccluders() {
  return impl_->SelectOccluders();
}
absl::StatusOr<image::FrameImage> FramePipeline::RenderOccluders(
    const std::vector<volume::BlockId>& hits) {
  return impl_->RenderOccluders(hits);
}
absl::StatusOr<image::FrameImage> FramePipeline::RenderVisible(
    const visibility::OcclusionMap& map) {
  return impl_->RenderVisible(map);
}
absl::StatusOr<image::FrameImage> FramePipeline::RenderAll() { return impl_->RenderAll(); }
const AgentStatistics& FramePipeline::statistics() const { return impl_->statistics(); }

}  // namespace isoscope::agent
