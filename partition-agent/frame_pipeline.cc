#include "partition-agent/frame_pipeline.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <span>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_format.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/clock.h"
#include "absl/types/span.h"
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/parallel_invoke.h>
#include <oneapi/tbb/partitioner.h>

#include "core/base/check.h"
#include "core/base/first_error.h"
#include "core/base/status_macros.h"
#include "core/composite/pixel_codec.h"
#include "core/extract/block_extractor.h"
#include "core/image/pixel_mask.h"
#include "core/io/read_queue.h"
#include "core/mesh/block_mesh.h"
#include "core/view/view.h"
#include "core/visibility/occluder_selection.h"
#include "core/visibility/open_pixels.h"
#include "core/volume/block_set.h"
#include "core/volume/range_table.h"
#include "partition-agent/queued_reads.h"

namespace isoscope::agent {
namespace {

// Rays one task casts: some hundred microseconds.
constexpr std::int64_t kRaysPerTask = 1024;
// Blocks one task takes from the cache, and how many tasks each thread should find: few blocks in
// large parts leave threads without work.
constexpr std::size_t kMinBlocksPerTask = 8;
constexpr std::size_t kMaxBlocksPerTask = 128;
constexpr std::size_t kTasksPerThread = 8;
// Meshes handed to the renderer at a time, at most; and how many are worth a call: it takes locks,
// and so few are still in the processor's cache when they are drawn.
constexpr std::size_t kMeshesPerAdd = 64;
constexpr std::size_t kMeshesWorthAdding = 16;

// A block to draw.
struct ChosenBlock {
  volume::BlockId block_id = 0;
  std::uint32_t ordinal = 0;
  std::uint32_t place = 0;  // in the list of active blocks of its shard
  std::uint32_t shard_slot = 0;
  const image::PixelMask* open = nullptr;  // null: all pixels
  bool must_read = false;
};

// What one thread keeps between its tasks.
struct Worker {
  Worker(const volume::GridGeometry& geometry, const volume::BlockLayout& layout,
         std::shared_ptr<const extract::BlockShapes> shapes, MeshCache* cache, std::uint64_t round)
      : extractor(geometry, layout, std::move(shapes)), writer(cache, round) {}

  extract::BlockExtractor extractor;
  MeshCache::Writer writer;
  // Extracted and not yet drawn: a task extracts all its blocks, then draws them.
  std::vector<render::MeshToDraw> meshes;
  std::int64_t triangle_count = 0;
  std::int64_t unique_vertex_count = 0;
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
       const view::View& view, const AgentResources& resources,
       const base::Cancellation* cancellation)
      : shards_(std::move(shards)),
        request_(request),
        view_(view),
        layout_(shards_.front()->reader->layout()),
        renderer_(resources.renderer),
        arena_(resources.arena),
        cache_(resources.cache),
        max_read_bytes_(resources.max_read_bytes),
        cancellation_(cancellation),
        round_(cache_->BeginRound(request.frame_number)),
        workers_([this] {
          return Worker(view_.geometry(), layout_, shards_.front()->shapes, cache_->meshes(),
                        round_);
        }) {}

  absl::StatusOr<RaySelection> SelectOccluders() {
    const ScopedTimer timer(&statistics_.busy_duration);
    // The rays need the range table only: pages of the tree are read meanwhile.
    absl::Status found;
    absl::StatusOr<std::vector<volume::BlockId>> hits;
    arena_->execute([&] {
      tbb::parallel_invoke([&] { found = FindOwnActiveBlocks(); }, [&] { hits = CastRays(); });
    });
    ISOSCOPE_RETURN_IF_ERROR(found);
    ISOSCOPE_RETURN_IF_ERROR(hits.status());
    RaySelection selection;
    selection.hits = *std::move(hits);
    if (request_.report_active_blocks) {
      for (const auto& of_shard : own_active_) {
        for (const ActiveBlock& block : *of_shard) {
          selection.active.push_back(block.block_id);
        }
      }
      std::sort(selection.active.begin(), selection.active.end());
    }
    return selection;
  }

  absl::StatusOr<image::FrameImage> RenderOccluders(const std::vector<volume::BlockId>& blocks) {
    const ScopedTimer timer(&statistics_.busy_duration);
    statistics_.occluding_block_count = static_cast<std::int64_t>(blocks.size());
    ISOSCOPE_ASSIGN_OR_RETURN(std::vector<ChosenBlock> chosen, Choose(blocks));
    return Draw(std::move(chosen));
  }

  absl::StatusOr<image::FrameImage> RenderVisible(const std::vector<volume::BlockId>& blocks,
                                                  absl::string_view open_pixels) {
    const ScopedTimer timer(&statistics_.busy_duration);
    std::vector<image::PixelMask> masks;
    if (!open_pixels.empty()) {
      std::vector<view::PixelRect> rects(blocks.size());
      arena_->execute([&] {
        tbb::parallel_for(
            tbb::blocked_range<std::size_t>(0, blocks.size(), kMaxBlocksPerTask),
            [&](const tbb::blocked_range<std::size_t>& range) {
              std::array<view::Footprint, kMaxBlocksPerTask> footprints;
              view_.FootprintsOf(layout_,
                                 absl::MakeSpan(blocks).subspan(range.begin(), range.size()),
                                 absl::MakeSpan(footprints).first(range.size()));
              for (std::size_t i = 0; i < range.size(); ++i) {
                rects[range.begin() + i] = footprints[i].rect;
              }
            },
            tbb::simple_partitioner());
      });
      ISOSCOPE_ASSIGN_OR_RETURN(masks, visibility::DecodeOpenPixels(open_pixels, rects));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(std::vector<ChosenBlock> chosen, Choose(blocks));
    if (!masks.empty()) {
      for (ChosenBlock& block : chosen) {
        const auto place = std::lower_bound(blocks.begin(), blocks.end(), block.block_id);
        block.open = &masks[static_cast<std::size_t>(place - blocks.begin())];
      }
    }
    return Draw(std::move(chosen));
  }

  absl::StatusOr<image::FrameImage> RenderAll() {
    const ScopedTimer timer(&statistics_.busy_duration);
    ISOSCOPE_RETURN_IF_ERROR(FindOwnActiveBlocks());
    std::vector<ChosenBlock> chosen;
    chosen.reserve(static_cast<std::size_t>(statistics_.active_block_count));
    for (std::size_t slot = 0; slot < shards_.size(); ++slot) {
      const std::vector<ActiveBlock>& active = *own_active_[slot];
      for (std::size_t place = 0; place < active.size(); ++place) {
        chosen.push_back({.block_id = active[place].block_id,
                          .ordinal = active[place].ordinal,
                          .place = static_cast<std::uint32_t>(place),
                          .shard_slot = static_cast<std::uint32_t>(slot)});
      }
    }
    return Draw(std::move(chosen));
  }

  std::vector<std::string> Encode(const image::FrameImage& image) {
    const ScopedTimer timer(&statistics_.busy_duration);
    return arena_->execute([&] { return composite::EncodePixels(image); });
  }

  [[nodiscard]] const frame::AgentStatistics& statistics() const { return statistics_; }

 private:
  // Step 0: fills own_active_.
  absl::Status FindOwnActiveBlocks() {
    for (const std::shared_ptr<const Shard>& shard : shards_) {
      std::shared_ptr<const std::vector<ActiveBlock>> active =
          cache_->FindActive(*shard, request_.isovalue);
      if (active == nullptr) {
        ISOSCOPE_RETURN_IF_ERROR(cancellation_->Check());
        ISOSCOPE_ASSIGN_OR_RETURN(active, QueryTree(*shard));
        cache_->InsertActive(*shard, request_.isovalue, active);
      }
      statistics_.active_block_count += static_cast<std::int64_t>(active->size());
      meshes_.push_back(
          cache_->meshes()->TableOf(shard->number, request_.isovalue, active->size()));
      own_active_.push_back(std::move(active));
    }
    return absl::OkStatus();
  }

  absl::StatusOr<std::shared_ptr<const std::vector<ActiveBlock>>> QueryTree(const Shard& shard) {
    ISOSCOPE_ASSIGN_OR_RETURN(const index::QueryResult result,
                              shard.tree->Query(request_.isovalue));
    statistics_.index_page_read_count += result.page_read_count;
    statistics_.read_bytes += result.read_bytes;
    const store::ShardReader& reader = *shard.reader;
    volume::BlockSet ids(layout_.block_count());
    for (const index::BlockInterval& interval : result.active) {
      if (interval.ordinal >= reader.block_count() ||
          reader.block_id(interval.ordinal) != interval.block_id) {
        return absl::DataLossError(absl::StrFormat(
            "%s: the interval tree names block %d at place %d of %d, where the block index has "
            "another",
            reader.directory(), interval.block_id, interval.ordinal, reader.block_count()));
      }
      ids.Insert(interval.block_id);
    }
    // Each to the place of its id among all: cheaper than sorting.
    const volume::BlockRanks ranks(ids);
    auto active = std::make_shared<std::vector<ActiveBlock>>(ranks.count());
    for (const index::BlockInterval& interval : result.active) {
      (*active)[ranks.RankOf(interval.block_id)] = {interval.block_id, interval.ordinal};
    }
    return active;
  }

  // Step 1.
  absl::StatusOr<std::vector<volume::BlockId>> CastRays() const {
    const volume::BlockSet active =
        shards_.front()->reader->ranges().ActiveBlocks(request_.isovalue);
    const visibility::RaySet rays(view_, layout_, request_.ray_seed);
    const visibility::RayShare share =
        visibility::ShareOfRays(rays.count(), request_.agent_index, request_.agent_count);
    const std::int64_t task_count = (share.end - share.begin + kRaysPerTask - 1) / kRaysPerTask;
    tbb::enumerable_thread_specific<volume::BlockSet> hits_by_thread(layout_.block_count());
    tbb::parallel_for(std::int64_t{0}, task_count, [&](std::int64_t task) {
      if (cancellation_->is_cancelled()) {
        return;
      }
      const std::int64_t begin = share.begin + task * kRaysPerTask;
      rays.Cast(begin, std::min(begin + kRaysPerTask, share.end), active, &hits_by_thread.local());
    });
    ISOSCOPE_RETURN_IF_ERROR(cancellation_->Check());
    volume::BlockSet hits(layout_.block_count());
    for (const volume::BlockSet& thread_hits : hits_by_thread) {
      hits.UnionWith(thread_hits);
    }
    return hits.Ids();
  }

  // Finds `ids`, ascending, among the agent's active blocks.
  absl::StatusOr<std::vector<ChosenBlock>> Choose(const std::vector<volume::BlockId>& ids) const {
    std::vector<ChosenBlock> chosen;
    chosen.reserve(ids.size());
    for (std::size_t slot = 0; slot < shards_.size(); ++slot) {
      auto id = ids.begin();
      const std::vector<ActiveBlock>& active = *own_active_[slot];
      for (std::size_t place = 0; place < active.size(); ++place) {
        const ActiveBlock& block = active[place];
        while (id != ids.end() && *id < block.block_id) {
          ++id;
        }
        if (id != ids.end() && *id == block.block_id) {
          chosen.push_back({.block_id = block.block_id,
                            .ordinal = block.ordinal,
                            .place = static_cast<std::uint32_t>(place),
                            .shard_slot = static_cast<std::uint32_t>(slot)});
        }
      }
    }
    if (chosen.size() != ids.size()) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%d of %d blocks to draw are not active blocks of this agent at isovalue %g",
          ids.size() - chosen.size(), ids.size(), request_.isovalue));
    }
    return chosen;
  }

  [[nodiscard]] std::size_t BlocksPerTask(std::size_t block_count) const {
    const auto threads = static_cast<std::size_t>(arena_->max_concurrency());
    return std::clamp(block_count / (threads * kTasksPerThread), kMinBlocksPerTask,
                      kMaxBlocksPerTask);
  }

  // Takes blocks from the cache, or reads and extracts them, and draws them.
  absl::StatusOr<image::FrameImage> Draw(std::vector<ChosenBlock> blocks) {
    ISOSCOPE_RETURN_IF_ERROR(cancellation_->Check());
    statistics_.visible_block_count += static_cast<std::int64_t>(blocks.size());
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<render::RenderPass> pass,
                              renderer_->BeginPass(view_, layout_, request_.appearance));
    const absl::Time start = absl::Now();
    base::FirstError error;
    arena_->execute([&] {
      tbb::parallel_for(
          tbb::blocked_range<std::size_t>(0, blocks.size(), BlocksPerTask(blocks.size())),
          [&](const tbb::blocked_range<std::size_t>& range) {
            DrawCached(&blocks, range.begin(), range.end(), pass.get(), &error);
          },
          tbb::simple_partitioner());
    });
    if (!error.has_error()) {
      error.Set(ReadAndDraw(blocks, pass.get()));
    }
    const absl::Duration draw_wall = absl::Now() - start;
    ISOSCOPE_RETURN_IF_ERROR(error.status());
    AddUpWorkers(draw_wall);
    const ScopedTimer timer(&statistics_.render_duration);
    return pass->Finish(*cancellation_);
  }

  // Draws those of blocks [begin, end) whose mesh or samples are cached, and marks the others.
  void DrawCached(std::vector<ChosenBlock>* blocks, std::size_t begin, std::size_t end,
                  render::RenderPass* pass, base::FirstError* error) {
    if (error->has_error()) {
      return;
    }
    Worker& worker = workers_.local();
    const absl::Time start = absl::Now();
    for (std::size_t i = begin; i < end; ++i) {
      ChosenBlock& block = (*blocks)[i];
      const Shard& shard = *shards_[block.shard_slot];
      auto mesh = meshes_[block.shard_slot]->Find(block.place, round_);
      if (mesh != nullptr) {
        worker.meshes.push_back({std::move(mesh), block.open});
        continue;
      }
      const auto samples = cache_->FindSamples(shard, block.ordinal);
      block.must_read = samples == nullptr;
      if (samples != nullptr) {
        Extract({block.block_id, shard.reader->manifest().scalar_type, samples->data()}, block,
                &worker);
      }
    }
    worker.extract_time += absl::Now() - start;
    error->Set(AddMeshes(pass, &worker));
  }

  // The blocks of one shard to read, by place in the shard, and how.
  struct ShardReads {
    std::vector<ChosenBlock> blocks;
    std::vector<std::uint32_t> ordinals;
    std::vector<store::ShardReader::Run> runs;
    std::size_t first_read = 0;  // of its runs, in the queue
  };

  // Reads, extracts and draws what is marked.
  absl::Status ReadAndDraw(const std::vector<ChosenBlock>& blocks, render::RenderPass* pass) {
    std::vector<ShardReads> by_shard(shards_.size());
    for (const ChosenBlock& block : blocks) {
      if (block.must_read) {
        by_shard[block.shard_slot].blocks.push_back(block);
      }
    }
    std::vector<io::ReadQueue::Read> reads;
    for (std::size_t slot = 0; slot < shards_.size(); ++slot) {
      ShardReads& of_shard = by_shard[slot];
      std::sort(of_shard.blocks.begin(), of_shard.blocks.end(),
                [](const ChosenBlock& a, const ChosenBlock& b) { return a.ordinal < b.ordinal; });
      of_shard.ordinals.reserve(of_shard.blocks.size());
      for (const ChosenBlock& block : of_shard.blocks) {
        of_shard.ordinals.push_back(block.ordinal);
      }
      const store::ShardReader& reader = *shards_[slot]->reader;
      of_shard.runs = reader.PlanRuns(of_shard.ordinals);
      of_shard.first_read = reads.size();
      for (const store::ShardReader::Run& run : of_shard.runs) {
        statistics_.read_bytes += run.size;
        reads.push_back(reader.RequestFor(run));
      }
    }
    io::ReadQueue queue(std::move(reads), {.max_bytes = max_read_bytes_});
    const absl::Status status =
        ForEachArrival(&queue, arena_, *cancellation_, [&](const io::ReadQueue::Arrival& arrival) {
          const auto after = std::upper_bound(
              by_shard.begin(), by_shard.end(), arrival.index(),
              [](std::size_t read, const ShardReads& of) { return read < of.first_read; });
          Worker& worker = workers_.local();
          ISOSCOPE_RETURN_IF_ERROR(
              ExtractRun(static_cast<std::size_t>(after - by_shard.begin()) - 1, *(after - 1),
                         arrival, &worker));
          return worker.meshes.size() < kMeshesWorthAdding ? absl::OkStatus()
                                                           : AddMeshes(pass, &worker);
        });
    ISOSCOPE_RETURN_IF_ERROR(status);
    base::FirstError error;
    arena_->execute([&] {
      tbb::parallel_for(workers_.range(1), [&](const auto& range) {
        for (Worker& worker : range) {
          error.Set(AddMeshes(pass, &worker));
        }
      });
    });
    return error.status();
  }

  absl::Status ExtractRun(std::size_t slot, const ShardReads& reads,
                          const io::ReadQueue::Arrival& arrival, Worker* worker) {
    const ScopedTimer timer(&worker->extract_time);
    const Shard& shard = *shards_[slot];
    const store::ShardReader::Run& run = reads.runs[arrival.index() - reads.first_read];
    const ChosenBlock* block = reads.blocks.data() + run.first;
    return shard.reader->VisitRun(
        run, reads.ordinals, arrival.status(), arrival.data(),
        [&](const volume::BlockSamples& samples) {
          ISOSCOPE_RETURN_IF_ERROR(cancellation_->Check());
          Extract(samples, *block, worker);
          cache_->OfferSamples(
              shard, block->ordinal,
              {samples.bytes, volume::StoredSizeBytes(layout_, samples.block_id, samples.type)});
          ++block;
          return absl::OkStatus();
        });
  }

  void Extract(const volume::BlockSamples& samples, const ChosenBlock& block,
               Worker* worker) const {
    const mesh::BlockMeshView mesh = worker->extractor.Extract(samples, request_.isovalue);
    worker->meshes.push_back(
        {worker->writer.Store(mesh, meshes_[block.shard_slot].get(), block.place), block.open});
  }

  // Draws the worker's meshes.
  absl::Status AddMeshes(render::RenderPass* pass, Worker* worker) const {
    const ScopedTimer timer(&worker->add_time);
    for (const render::MeshToDraw& item : worker->meshes) {
      worker->triangle_count += item.mesh->triangle_count();
      worker->unique_vertex_count += item.mesh->owned_vertex_count;
    }
    // A part at a time, so that a cancelled frame ends soon.
    absl::Status status;
    std::span<const render::MeshToDraw> rest = worker->meshes;
    while (status.ok() && !rest.empty()) {
      const std::size_t count = std::min(rest.size(), kMeshesPerAdd);
      status = cancellation_->Check();
      if (status.ok()) {
        status = pass->Add(rest.first(count));
      }
      rest = rest.subspan(count);
    }
    worker->meshes.clear();
    return status;
  }

  // Threads extract and draw in turn: the wall time is shared out by what they spent on each.
  void AddUpWorkers(absl::Duration wall) {
    absl::Duration extract_time;
    absl::Duration add_time;
    for (Worker& worker : workers_) {
      statistics_.triangle_count += std::exchange(worker.triangle_count, 0);
      statistics_.unique_vertex_count += std::exchange(worker.unique_vertex_count, 0);
      extract_time += std::exchange(worker.extract_time, absl::ZeroDuration());
      add_time += std::exchange(worker.add_time, absl::ZeroDuration());
    }
    const absl::Duration total = extract_time + add_time;
    const double add_share =
        total > absl::ZeroDuration() ? absl::FDivDuration(add_time, total) : 0.0;
    statistics_.extract_duration += wall * (1.0 - add_share);
    statistics_.render_duration += wall * add_share;
  }

  const std::vector<std::shared_ptr<const Shard>> shards_;
  const FrameRequest request_;
  const view::View view_;
  const volume::BlockLayout layout_;
  render::Renderer* const renderer_;
  tbb::task_arena* const arena_;
  BlockCache* const cache_;
  const std::size_t max_read_bytes_;
  const base::Cancellation* const cancellation_;
  const std::uint64_t round_;

  // By shard, ascending by block id; and where their meshes are kept.
  std::vector<std::shared_ptr<const std::vector<ActiveBlock>>> own_active_;
  std::vector<std::shared_ptr<MeshTable>> meshes_;
  tbb::enumerable_thread_specific<Worker> workers_;
  frame::AgentStatistics statistics_;
};

absl::StatusOr<std::unique_ptr<FramePipeline>> FramePipeline::Make(
    std::vector<std::shared_ptr<const Shard>> shards, const FrameRequest& request,
    const AgentResources& resources, const base::Cancellation* cancellation) {
  ISOSCOPE_CHECK(!shards.empty());
  for (const std::shared_ptr<const Shard>& shard : shards) {
    ISOSCOPE_CHECK_EQ(shard->reader->manifest().dataset_id,
                      shards.front()->reader->manifest().dataset_id);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const view::View view,
                            view::View::Make(request.camera, request.viewport,
                                             shards.front()->reader->manifest().geometry));
  return std::unique_ptr<FramePipeline>(new FramePipeline(
      std::make_unique<Impl>(std::move(shards), request, view, resources, cancellation)));
}

FramePipeline::FramePipeline(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
FramePipeline::~FramePipeline() = default;

absl::StatusOr<RaySelection> FramePipeline::SelectOccluders() { return impl_->SelectOccluders(); }
absl::StatusOr<image::FrameImage> FramePipeline::RenderOccluders(
    const std::vector<volume::BlockId>& blocks) {
  return impl_->RenderOccluders(blocks);
}
absl::StatusOr<image::FrameImage> FramePipeline::RenderVisible(
    const std::vector<volume::BlockId>& blocks, absl::string_view open_pixels) {
  return impl_->RenderVisible(blocks, open_pixels);
}
absl::StatusOr<image::FrameImage> FramePipeline::RenderAll() { return impl_->RenderAll(); }
std::vector<std::string> FramePipeline::Encode(const image::FrameImage& image) {
  return impl_->Encode(image);
}
const frame::AgentStatistics& FramePipeline::statistics() const { return impl_->statistics(); }

}  // namespace isoscope::agent
