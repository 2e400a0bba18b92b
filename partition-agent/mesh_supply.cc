// A delivery has two parts, so that no thread of the arena waits for a disk:
//
//   1. Tasks of 8 to 128 meshes go through the chosen meshes. A kept mesh is handed on as it is. If
//      the samples of its block are kept, it is extracted at once. Part 2 makes the others.
//   2. The blocks that are left are sorted by ordinal and read as disk runs. A block that arrives
//      is checked, and extracted for all surfaces that want it, while others are under way.
//
// Each thread collects meshes and gives the sink a few dozen at a time: a call takes locks, and a
// few dozen meshes are still in the processor's cache when they are drawn. Extracted meshes are
// kept where the cache has room.
//
// When the sink is full, every thread ends its loop after the delivery in hand. The frame's thread
// drains the sink outside of the parallel loops, so that nothing waits inside of one, and both
// parts go on where they stopped: part 1 with the tasks that are left, part 2 within the disk runs.

#include "partition-agent/mesh_supply.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <string>
#include <tuple>
#include <utility>

#include "absl/time/clock.h"
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/partitioner.h>

#include "core/base/first_error.h"
#include "core/base/scoped_timer.h"
#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/base/trace_recorder.h"
#include "core/extract/block_extractor.h"
#include "partition-agent/queued_reads.h"

namespace isoscope::agent {
namespace {

// The fewest meshes of a task, and the number of tasks for each thread. Too few tasks would leave
// threads without work.
constexpr std::size_t kMinMeshesPerTask = 8;
constexpr std::size_t kMaxMeshesPerTask = MeshSupply::kMaxDeliveryMeshes;
constexpr std::size_t kTasksPerThread = 8;
constexpr std::size_t kNoMesh = std::numeric_limits<std::size_t>::max();
// The number of meshes that is worth a call.
constexpr std::size_t kMeshesWorthDelivering = 16;

// The state that one thread keeps between its tasks.
struct Worker {
  Worker(const Shard& shard, MeshCache* cache, std::uint64_t round, std::size_t surface_count)
      : extractor(shard.reader->manifest().geometry, shard.reader->layout(), shard.shapes),
        writer(cache, round),
        surfaces(surface_count) {}

  extract::BlockExtractor extractor;
  MeshCache::Writer writer;
  std::vector<render::MeshToDraw> meshes;  // found or extracted, not yet delivered
  std::size_t mesh_bytes = 0;              // of those extracted since the last delivery
  std::vector<frame::SurfaceStatistics> surfaces;
  absl::Duration extract_time;
  absl::Duration deliver_time;
  std::int64_t kept_mesh_count = 0;
  std::int64_t kept_sample_count = 0;
};

// The blocks to read of one shard.
struct ShardReads {
  std::vector<std::uint32_t> ordinals;    // ascending, each once
  std::vector<std::size_t> first_wanted;  // of each ordinal, in the list of wanted meshes
  std::vector<store::ShardReader::DiskRun> disk_runs;
  std::size_t first_read = 0;  // of its disk runs, in the queue
};

}  // namespace

class MeshSupply::Impl {
 public:
  Impl(const SurfaceBlocks* blocks, std::uint64_t cache_round, const AgentResources& resources,
       const base::Cancellation* cancellation, std::vector<bool> keeps_gradient_magnitudes)
      : blocks_(*blocks),
        arena_(*resources.arena),
        cache_(*resources.cache),
        max_read_bytes_(resources.max_read_bytes),
        trace_(resources.trace),
        metrics_(resources.metrics),
        cancellation_(*cancellation),
        round_(cache_round),
        keeps_gradient_magnitudes_(std::move(keeps_gradient_magnitudes)) {
    keeps_gradient_magnitudes_.resize(blocks_.isovalues().size(), false);
  }

  absl::StatusOr<SupplyCost> DeliverMeshes(const std::vector<ChosenMesh>& chosen, MeshSink* sink) {
    OpenTables();
    SupplyCost cost;
    cost.surfaces.resize(blocks_.isovalues().size());
    const absl::Time start = absl::Now();
    std::vector<char> is_missing(chosen.size(), 0);
    ISOSCOPE_RETURN_IF_ERROR(DeliverKept(chosen, &is_missing, sink));
    std::vector<std::size_t> wanted;
    for (std::size_t i = 0; i < chosen.size(); ++i) {
      if (is_missing[i] != 0) {
        wanted.push_back(i);
      }
    }
    CountLookups(static_cast<std::int64_t>(wanted.size()));
    ISOSCOPE_RETURN_IF_ERROR(ReadSamples(
        chosen, std::move(wanted), &cost.read_bytes,
        [&](std::span<const std::size_t> of_block, const volume::BlockSamples& samples) {
          return ExtractRead(chosen, of_block, samples, sink);
        },
        {.is_due = [&] { return sink->is_full(); }, .pause = [&] { return sink->Drain(); }}));
    ISOSCOPE_RETURN_IF_ERROR(DeliverRest(sink));
    AddUpWorkers(absl::Now() - start, &cost);
    return cost;
  }

  absl::StatusOr<std::vector<mesh::BlockMesh>> ExtractWithEdgeKeys(
      const std::vector<ChosenMesh>& chosen) {
    std::vector<mesh::BlockMesh> meshes(chosen.size());
    const auto extract = [&](std::size_t i, const volume::BlockSamples& samples) {
      keyed_extractors_.local().ExtractWithEdgeKeys(
          samples, blocks_.isovalues()[chosen[i].surface_index], &meshes[i]);
    };
    std::vector<std::size_t> wanted(chosen.size());
    for (std::size_t i = 0; i < chosen.size(); ++i) {
      wanted[i] = i;
    }
    std::int64_t read_bytes = 0;
    ISOSCOPE_RETURN_IF_ERROR(ReadSamples(
        chosen, std::move(wanted), &read_bytes,
        [&](std::span<const std::size_t> of_block, const volume::BlockSamples& samples) {
          for (const std::size_t i : of_block) {
            extract(i, samples);
          }
          return cancellation_.Check();
        },
        {.is_due = [] { return false; }, .pause = [] { return absl::OkStatus(); }}));
    return meshes;
  }

 private:
  // Called with the indices of the wanted meshes of one block, and its samples.
  using VisitSamples =
      absl::FunctionRef<absl::Status(std::span<const std::size_t>, const volume::BlockSamples&)>;

  [[nodiscard]] const Shard& ShardOf(const ChosenMesh& mesh) const {
    return *blocks_.shards()[mesh.shard_index];
  }
  [[nodiscard]] MeshTable& TableOf(const ChosenMesh& mesh) const {
    return *tables_[mesh.shard_index * blocks_.isovalues().size() + mesh.surface_index];
  }

  // Finds the tables of kept meshes.
  void OpenTables() {
    if (!tables_.empty()) {
      return;
    }
    for (std::size_t shard = 0; shard < blocks_.shards().size(); ++shard) {
      for (std::size_t surface = 0; surface < blocks_.isovalues().size(); ++surface) {
        tables_.push_back(cache_.meshes()->TableOf(
            blocks_.shards()[shard]->number, blocks_.isovalues()[surface],
            blocks_.ActiveOf(shard, surface).size(), keeps_gradient_magnitudes_[surface]));
      }
    }
  }

  // Part 1: delivers meshes that are kept, or whose samples are kept, and marks the others.
  absl::Status DeliverKept(const std::vector<ChosenMesh>& chosen, std::vector<char>* is_missing,
                           MeshSink* sink) {
    const auto threads = static_cast<std::size_t>(base::ConcurrencyOf(arena_));
    const std::size_t per_task = std::clamp(chosen.size() / (threads * kTasksPerThread),
                                            kMinMeshesPerTask, kMaxMeshesPerTask);
    // The first mesh of each task, or kNoMesh once it is done.
    std::vector<std::size_t> tasks;
    for (std::size_t begin = 0; begin < chosen.size(); begin += per_task) {
      tasks.push_back(begin);
    }
    base::FirstError error;
    while (!tasks.empty()) {
      base::RunIn(&arena_, [&] {
        tbb::parallel_for(
            tbb::blocked_range<std::size_t>(0, tasks.size()),
            [&](const tbb::blocked_range<std::size_t>& range) {
              for (std::size_t i = range.begin(); i < range.end(); ++i) {
                if (error.has_error() || sink->is_full()) {
                  return;
                }
                const std::size_t end = std::min(tasks[i] + per_task, chosen.size());
                error.Set(FindAndDeliver(chosen, std::exchange(tasks[i], kNoMesh), end, is_missing,
                                         sink));
              }
            },
            tbb::simple_partitioner());
      });
      ISOSCOPE_RETURN_IF_ERROR(error.status());
      ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
      std::erase(tasks, kNoMesh);
      ISOSCOPE_RETURN_IF_ERROR(DrainIfFull(sink));
    }
    return absl::OkStatus();
  }

  static absl::Status DrainIfFull(MeshSink* sink) {
    return sink->is_full() ? sink->Drain() : absl::OkStatus();
  }

  // One task of part 1: meshes [begin, end) of `chosen`.
  absl::Status FindAndDeliver(const std::vector<ChosenMesh>& chosen, std::size_t begin,
                              std::size_t end, std::vector<char>* is_missing, MeshSink* sink) {
    Worker& worker = workers_.local();
    const base::TraceScope trace(trace_, "extract");
    const absl::Time start = absl::Now();
    for (std::size_t i = begin; i < end && !cancellation_.is_cancelled(); ++i) {
      (*is_missing)[i] = FindKept(chosen[i], &worker) ? 0 : 1;
    }
    worker.extract_time += absl::Now() - start;
    return DeliverFrom(&worker, sink);
  }

  // Counts what was found and what was not, once for all meshes of a delivery.
  void CountLookups(std::int64_t missing_count) {
    std::int64_t kept_mesh_count = 0;
    std::int64_t kept_sample_count = 0;
    for (Worker& worker : workers_) {
      kept_mesh_count += std::exchange(worker.kept_mesh_count, 0);
      kept_sample_count += std::exchange(worker.kept_sample_count, 0);
    }
    if (metrics_ != nullptr) {
      metrics_->mesh_hits.Add(kept_mesh_count);
      metrics_->mesh_misses.Add(kept_sample_count + missing_count);
      metrics_->sample_hits.Add(kept_sample_count);
      metrics_->sample_misses.Add(missing_count);
    }
  }

  bool FindKept(const ChosenMesh& chosen, Worker* worker) {
    auto mesh = TableOf(chosen).Find(chosen.active_index, round_);
    if (mesh != nullptr) {
      ++worker->kept_mesh_count;
      worker->meshes.push_back({std::move(mesh), chosen.surface_index, chosen.open});
      return true;
    }
    const Shard& shard = ShardOf(chosen);
    const std::shared_ptr<const std::string> samples = cache_.FindSamples(shard, chosen.ordinal);
    if (samples == nullptr) {
      return false;
    }
    ++worker->kept_sample_count;
    Extract({chosen.block_id, shard.reader->manifest().scalar_type, samples->data()}, chosen,
            worker);
    return true;
  }

  void Extract(const volume::BlockSamples& samples, const ChosenMesh& chosen, Worker* worker) {
    const mesh::BlockMeshView mesh =
        worker->extractor.Extract(samples, blocks_.isovalues()[chosen.surface_index],
                                  keeps_gradient_magnitudes_[chosen.surface_index]);
    worker->meshes.push_back({worker->writer.Store(mesh, &TableOf(chosen), chosen.active_index),
                              chosen.surface_index, chosen.open});
    worker->mesh_bytes += worker->meshes.back().mesh->size_bytes();
  }

  // Part 2: reads the blocks of chosen[i], i in `wanted`, each once, and visits their samples.
  absl::Status ReadSamples(const std::vector<ChosenMesh>& chosen, std::vector<std::size_t> wanted,
                           std::int64_t* read_bytes, const VisitSamples& visit,
                           const Pauses& pauses) {
    std::sort(wanted.begin(), wanted.end(), [&](std::size_t a, std::size_t b) {
      return std::tie(chosen[a].shard_index, chosen[a].ordinal, chosen[a].surface_index) <
             std::tie(chosen[b].shard_index, chosen[b].ordinal, chosen[b].surface_index);
    });
    std::vector<ShardReads> by_shard(blocks_.shards().size());
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      const ChosenMesh& mesh = chosen[wanted[i]];
      ShardReads& of_shard = by_shard[mesh.shard_index];
      if (of_shard.ordinals.empty() || of_shard.ordinals.back() != mesh.ordinal) {
        of_shard.ordinals.push_back(mesh.ordinal);
        of_shard.first_wanted.push_back(i);
      }
    }
    std::vector<io::ReadQueue::Read> reads;
    for (std::size_t shard = 0; shard < by_shard.size(); ++shard) {
      const store::ShardReader& reader = *blocks_.shards()[shard]->reader;
      ShardReads& of_shard = by_shard[shard];
      of_shard.disk_runs = reader.PlanDiskRuns(of_shard.ordinals);
      of_shard.first_read = reads.size();
      for (const store::ShardReader::DiskRun& disk_run : of_shard.disk_runs) {
        *read_bytes += disk_run.size;
        reads.push_back(reader.RequestFor(disk_run));
      }
    }
    if (metrics_ != nullptr) {
      metrics_->reads.Add(static_cast<std::int64_t>(reads.size()));
      metrics_->read_bytes.Add(*read_bytes);
    }
    std::vector<std::size_t> visited(reads.size());  // blocks of each read
    io::ReadQueue queue(std::move(reads), {.max_bytes = max_read_bytes_});
    return ForEachArrival(
        &queue, &arena_, cancellation_,
        [&](const io::ReadQueue::Arrival& arrival) {
          const auto after = std::upper_bound(
              by_shard.begin(), by_shard.end(), arrival.index(),
              [](std::size_t read, const ShardReads& of) { return read < of.first_read; });
          return VisitArrival(
              chosen, wanted, *(after - 1),
              *blocks_.shards()[static_cast<std::size_t>(after - by_shard.begin() - 1)], arrival,
              visit, pauses, &visited[arrival.index()]);
        },
        pauses, {.trace = trace_, .wait = metrics_ != nullptr ? &metrics_->read_wait : nullptr});
  }

  // Visits the blocks of an arrival from the `visited`th on, until a pause is due.
  static absl::StatusOr<ArrivalWork> VisitArrival(const std::vector<ChosenMesh>& chosen,
                                                  const std::vector<std::size_t>& wanted,
                                                  const ShardReads& reads, const Shard& shard,
                                                  const io::ReadQueue::Arrival& arrival,
                                                  const VisitSamples& visit, const Pauses& pauses,
                                                  std::size_t* visited) {
    store::ShardReader::DiskRun rest = reads.disk_runs[arrival.index() - reads.first_read];
    const std::size_t run_end = rest.first + rest.count;  // of the shard's ordinals
    rest.first += *visited;
    rest.count -= *visited;
    std::size_t next = rest.first;
    bool is_paused = false;
    absl::Status status = shard.reader->VisitDiskRun(
        rest, reads.ordinals, arrival.status(), arrival.data(),
        [&](const volume::BlockSamples& samples) {
          const std::size_t begin = reads.first_wanted[next++];
          ++*visited;
          std::size_t end = begin + 1;
          while (end < wanted.size() && chosen[wanted[end]].block_id == samples.block_id) {
            ++end;
          }
          ISOSCOPE_RETURN_IF_ERROR(visit(std::span(wanted).subspan(begin, end - begin), samples));
          is_paused = next < run_end && pauses.is_due();
          return is_paused ? absl::AbortedError("a pause is due") : absl::OkStatus();
        });
    if (is_paused) {
      return ArrivalWork::kPaused;
    }
    ISOSCOPE_RETURN_IF_ERROR(std::move(status));
    return ArrivalWork::kDone;
  }

  absl::Status ExtractRead(const std::vector<ChosenMesh>& chosen,
                           std::span<const std::size_t> of_block,
                           const volume::BlockSamples& samples, MeshSink* sink) {
    Worker& worker = workers_.local();
    {
      const base::ScopedTimer timer(&worker.extract_time);
      ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
      for (const std::size_t i : of_block) {
        Extract(samples, chosen[i], &worker);
      }
      const ChosenMesh& first = chosen[of_block.front()];
      const Shard& shard = ShardOf(first);
      cache_.OfferSamples(shard, first.ordinal,
                          {samples.bytes, volume::StoredSizeBytes(shard.reader->layout(),
                                                                  samples.block_id, samples.type)});
    }
    const bool is_worth_it =
        worker.meshes.size() >= kMeshesWorthDelivering || worker.mesh_bytes >= kMaxDeliveryBytes;
    return is_worth_it ? DeliverFrom(&worker, sink) : absl::OkStatus();
  }

  // Delivers the worker's meshes, a part at a time, so that a cancelled frame ends soon. Leaves the
  // rest to the worker if the sink is full.
  absl::Status DeliverFrom(Worker* worker, MeshSink* sink) const {
    const std::span<const render::MeshToDraw> meshes = worker->meshes;
    if (meshes.empty() || sink->is_full()) {
      return absl::OkStatus();
    }
    const base::TraceScope trace(trace_, "draw");
    const base::ScopedTimer timer(&worker->deliver_time);
    absl::Status status;
    std::size_t begin = 0;
    while (status.ok() && begin < meshes.size() && !sink->is_full()) {
      status = cancellation_.Check();
      std::size_t end = begin;
      std::size_t bytes = 0;
      for (; end < meshes.size() && end - begin < kMaxDeliveryMeshes && bytes < kMaxDeliveryBytes;
           ++end) {
        const render::MeshToDraw& item = meshes[end];
        bytes += item.mesh->size_bytes();
        worker->surfaces[item.surface_index] +=
            {.triangle_count = item.mesh->triangle_count(),
             .unique_vertex_count = item.mesh->owned_vertex_count};
      }
      if (status.ok()) {
        status = sink->Take(meshes.subspan(begin, end - begin));
      }
      begin = end;
    }
    worker->meshes.erase(worker->meshes.begin(),
                         worker->meshes.begin() + static_cast<std::ptrdiff_t>(begin));
    worker->mesh_bytes = 0;
    return status;
  }

  absl::Status DeliverRest(MeshSink* sink) {
    while (true) {
      base::FirstError error;
      base::RunIn(&arena_, [&] {
        tbb::parallel_for(workers_.range(1), [&](const auto& range) {
          for (Worker& worker : range) {
            error.Set(DeliverFrom(&worker, sink));
          }
        });
      });
      ISOSCOPE_RETURN_IF_ERROR(error.status());
      if (std::all_of(workers_.begin(), workers_.end(),
                      [](const Worker& worker) { return worker.meshes.empty(); })) {
        return absl::OkStatus();
      }
      ISOSCOPE_RETURN_IF_ERROR(DrainIfFull(sink));
    }
  }

  // Threads extract and deliver in turn. The wall time is shared out in proportion to their times.
  void AddUpWorkers(absl::Duration wall, SupplyCost* cost) {
    absl::Duration extract_time;
    absl::Duration deliver_time;
    for (Worker& worker : workers_) {
      for (std::size_t i = 0; i < worker.surfaces.size(); ++i) {
        cost->surfaces[i] += std::exchange(worker.surfaces[i], {});
      }
      extract_time += std::exchange(worker.extract_time, absl::ZeroDuration());
      deliver_time += std::exchange(worker.deliver_time, absl::ZeroDuration());
    }
    const absl::Duration total = extract_time + deliver_time;
    const double deliver_share =
        total > absl::ZeroDuration() ? absl::FDivDuration(deliver_time, total) : 0.0;
    cost->extract_duration += wall * (1.0 - deliver_share);
    cost->deliver_duration += wall * deliver_share;
  }

  const SurfaceBlocks& blocks_;
  tbb::task_arena& arena_;
  BlockCache& cache_;
  const std::size_t max_read_bytes_;
  base::TraceRecorder* const trace_;  // null: none is asked for
  AgentMetrics* const metrics_;       // null: nobody counts
  const base::Cancellation& cancellation_;
  const std::uint64_t round_;
  std::vector<bool> keeps_gradient_magnitudes_;  // by surface

  std::vector<std::shared_ptr<MeshTable>> tables_;  // by shard, surface
  tbb::enumerable_thread_specific<Worker> workers_{[this] {
    return Worker(*blocks_.shards().front(), cache_.meshes(), round_, blocks_.isovalues().size());
  }};
  tbb::enumerable_thread_specific<extract::BlockExtractor> keyed_extractors_{[this] {
    const Shard& shard = *blocks_.shards().front();
    return extract::BlockExtractor(shard.reader->manifest().geometry, shard.reader->layout(),
                                   shard.shapes);
  }};
};

MeshSupply::MeshSupply(const SurfaceBlocks* blocks, std::uint64_t cache_round,
                       const AgentResources& resources, const base::Cancellation* cancellation,
                       std::vector<bool> keeps_gradient_magnitudes)
    : impl_(std::make_unique<Impl>(blocks, cache_round, resources, cancellation,
                                   std::move(keeps_gradient_magnitudes))) {}
MeshSupply::~MeshSupply() = default;

absl::StatusOr<SupplyCost> MeshSupply::DeliverMeshes(const std::vector<ChosenMesh>& chosen,
                                                     MeshSink* sink) {
  return impl_->DeliverMeshes(chosen, sink);
}

absl::StatusOr<std::vector<mesh::BlockMesh>> MeshSupply::ExtractWithEdgeKeys(
    const std::vector<ChosenMesh>& chosen) {
  return impl_->ExtractWithEdgeKeys(chosen);
}

}  // namespace isoscope::agent
