// A step's meshes come in two parts, so that no thread of the arena waits for a disk:
//
//   1. Tasks of 8 to 128 meshes go through the chosen meshes. A cached mesh is added as it is. If
//      the samples of its block are cached, it is extracted at once. Part 2 makes the others.
//   2. The blocks that are left are sorted by ordinal and read as disk runs. A block that arrives
//      is checked, and extracted for all surfaces that want it, while others are under way. Samples
//      that colour them are read before (color_volumes.h).
//
// Each thread collects meshes and adds a few dozen at a time: a call of the sink takes locks, and a
// few dozen meshes are still in the processor's cache when they are drawn. Extracted meshes are
// cached if there is room.
//
// When the sink is full, every thread ends its loop after its present batch. The frame's thread
// drains the sink outside of the parallel loops, so that no thread waits inside of one. Then both
// parts resume: part 1 with the remaining tasks, part 2 within the disk runs.

#include "partition-agent/supply/mesh_supply.h"

#include <algorithm>
#include <limits>
#include <optional>
#include <string>
#include <tuple>
#include <utility>

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/partitioner.h>

#include "core/base/first_error.h"
#include "core/base/monotonic_time.h"
#include "core/base/scoped_timer.h"
#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/base/trace_recorder.h"
#include "partition-agent/supply/block_reads.h"

namespace isoscope::agent {
namespace {

// The fewest meshes of a task, and the number of tasks for each thread. Too few tasks would leave
// threads without work.
constexpr std::size_t kMinMeshesPerTask = 8;
constexpr std::size_t kMaxMeshesPerTask = MeshWorker::kMaxBatchMeshes;
constexpr std::size_t kTasksPerThread = 8;
constexpr std::size_t kNoMesh = std::numeric_limits<std::size_t>::max();
// The number of meshes that is worth a call of the sink.
constexpr std::size_t kMeshesWorthAdding = 16;

absl::Status DrainIfFull(MeshSink* sink) {
  return sink->is_full() ? sink->Drain() : absl::OkStatus();
}

}  // namespace

MeshSupply::MeshSupply(const SurfaceBlocks* blocks, std::uint64_t cache_round,
                       const AgentResources& resources, const base::Cancellation* cancellation,
                       std::vector<bool> keeps_gradient_magnitudes, ColorVolumes colors)
    : blocks_(*blocks),
      resources_(resources),
      cancellation_(*cancellation),
      round_(cache_round),
      keeps_gradient_magnitudes_(std::move(keeps_gradient_magnitudes)),
      colors_(std::move(colors)),
      workers_([this] {
        return MeshWorker(*blocks_.shards().front(), resources_.cache->meshes(), round_,
                          blocks_.rules().size());
      }) {
  keeps_gradient_magnitudes_.resize(blocks_.rules().size(), false);
}

absl::StatusOr<SupplyCost> MeshSupply::AddMeshes(const std::vector<ChosenMesh>& chosen,
                                                 MeshSink* sink) {
  ISOSCOPE_RETURN_IF_ERROR(CheckColors(chosen));
  OpenTables();
  SupplyCost cost;
  cost.surfaces.resize(blocks_.rules().size());
  const base::MonotonicTime start = base::MonotonicNow();
  std::vector<char> is_missing(chosen.size(), 0);
  ISOSCOPE_RETURN_IF_ERROR(AddCached(chosen, &is_missing, sink));
  std::vector<std::size_t> missing;
  for (std::size_t i = 0; i < chosen.size(); ++i) {
    if (is_missing[i] != 0) {
      missing.push_back(i);
    }
  }
  CountLookups(static_cast<std::int64_t>(missing.size()));
  ISOSCOPE_RETURN_IF_ERROR(AddRead(chosen, std::move(missing), sink, &cost.read_bytes));
  ISOSCOPE_RETURN_IF_ERROR(AddRest(sink));
  AddUpWorkers(base::MonotonicNow() - start, &cost);
  // Frames wait for each other between their steps. Each would keep scratch and a chunk of memory a
  // thread.
  workers_.clear();
  return cost;
}

MeshValues MeshSupply::ValuesOf(std::size_t shard_index, std::size_t surface_index) const {
  if (const Shard* const field = colors_.ShardOf(shard_index, surface_index); field != nullptr) {
    return {.of = MeshValues::Of::kField, .field_shard_number = field->number};
  }
  return {.of = keeps_gradient_magnitudes_[surface_index] ? MeshValues::Of::kGradientMagnitude
                                                          : MeshValues::Of::kNothing};
}

absl::Status MeshSupply::CheckColors(const std::vector<ChosenMesh>& chosen) const {
  if (!colors_.empty()) {
    for (const ChosenMesh& mesh : chosen) {
      ISOSCOPE_RETURN_IF_ERROR(colors_.CheckBlock(mesh.shard_index, mesh.ordinal, mesh.block_id));
    }
  }
  return absl::OkStatus();
}

// Finds the tables of cached meshes.
void MeshSupply::OpenTables() {
  if (!tables_.empty()) {
    return;
  }
  for (std::size_t shard = 0; shard < blocks_.shards().size(); ++shard) {
    for (std::size_t surface = 0; surface < blocks_.rules().size(); ++surface) {
      tables_.push_back(resources_.cache->meshes()->TableOf(
          blocks_.shards()[shard]->number, blocks_.rules()[surface],
          blocks_.ActiveOf(shard, surface).size(), ValuesOf(shard, surface)));
    }
  }
}

void MeshSupply::EraseCached(std::vector<ChosenMesh>* chosen) {
  OpenTables();
  std::erase_if(*chosen,
                [this](const ChosenMesh& mesh) { return TableOf(mesh).Has(mesh.active_index); });
}

// Part 1: adds meshes that are cached, or whose samples are cached, and marks the others.
absl::Status MeshSupply::AddCached(const std::vector<ChosenMesh>& chosen,
                                   std::vector<char>* is_missing, MeshSink* sink) {
  const auto threads = static_cast<std::size_t>(base::ConcurrencyOf(*resources_.arena));
  const std::size_t per_task =
      std::clamp(chosen.size() / (threads * kTasksPerThread), kMinMeshesPerTask, kMaxMeshesPerTask);
  // The first mesh of each task, or kNoMesh once it is done.
  std::vector<std::size_t> tasks;
  for (std::size_t begin = 0; begin < chosen.size(); begin += per_task) {
    tasks.push_back(begin);
  }
  base::FirstError error;
  const auto run_task = [&](std::size_t task) {
    if (error.has_error() || sink->is_full()) {
      return;
    }
    const std::size_t begin = std::exchange(tasks[task], kNoMesh);
    const std::size_t count = std::min(per_task, chosen.size() - begin);
    error.Set(FindAndAdd(std::span(chosen).subspan(begin, count),
                         std::span(*is_missing).subspan(begin, count), sink));
  };
  while (!tasks.empty()) {
    base::RunIn(resources_.arena, [&] {
      tbb::parallel_for(
          tbb::blocked_range<std::size_t>(0, tasks.size()),
          [&](const tbb::blocked_range<std::size_t>& range) {
            for (std::size_t task = range.begin(); task < range.end(); ++task) {
              run_task(task);
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

// One task of part 1.
absl::Status MeshSupply::FindAndAdd(std::span<const ChosenMesh> chosen, std::span<char> is_missing,
                                    MeshSink* sink) {
  MeshWorker& worker = workers_.local();
  const base::TraceScope trace(resources_.trace, "extract");
  const base::MonotonicTime start = base::MonotonicNow();
  for (std::size_t i = 0; i < chosen.size() && !cancellation_.is_cancelled(); ++i) {
    is_missing[i] = Find(chosen[i], &worker) ? 0 : 1;
  }
  worker.extract_time += base::MonotonicNow() - start;
  return worker.AddTo(sink, cancellation_, resources_.trace);
}

bool MeshSupply::Find(const ChosenMesh& chosen, MeshWorker* worker) {
  if (auto mesh = TableOf(chosen).Find(chosen.active_index, round_); mesh != nullptr) {
    ++worker->cached_mesh_count;
    worker->Collect(std::move(mesh), chosen);
    return true;
  }
  const Shard& shard = ShardOf(chosen);
  const std::shared_ptr<const std::string> samples =
      resources_.cache->FindSamples(shard, chosen.ordinal);
  if (samples == nullptr) {
    return false;
  }
  std::shared_ptr<const std::string> bytes_of_field;
  volume::BlockSamples field;
  if (const Shard* const field_shard = colors_.ShardOf(chosen.shard_index, chosen.surface_index);
      field_shard != nullptr) {
    bytes_of_field = resources_.cache->FindSamples(*field_shard, chosen.ordinal);
    if (bytes_of_field == nullptr) {
      return false;
    }
    field = SamplesOf(*field_shard, chosen.ordinal, *bytes_of_field);
  }
  ++worker->cached_sample_count;
  Extract(SamplesOf(shard, chosen.ordinal, *samples), bytes_of_field != nullptr ? &field : nullptr,
          chosen, worker);
  return true;
}

// `field`: the samples that the values of vertices come of; null: of none
void MeshSupply::Extract(const volume::BlockSamples& samples, const volume::BlockSamples* field,
                         const ChosenMesh& chosen, MeshWorker* worker) {
  const volume::InsideRule& rule = blocks_.rules()[chosen.surface_index];
  const mesh::BlockMeshView mesh =
      field != nullptr ? worker->extractor.ExtractWithField(samples, rule, *field)
                       : worker->extractor.Extract(
                             samples, rule, keeps_gradient_magnitudes_[chosen.surface_index]);
  worker->Collect(worker->writer.Store(mesh, &TableOf(chosen), chosen.active_index), chosen);
  worker->mesh_bytes += worker->meshes.back().mesh->size_bytes();
}

// Counts hits and misses, once for all meshes of a step.
void MeshSupply::CountLookups(std::int64_t missing_count) {
  std::int64_t mesh_count = 0;
  std::int64_t sample_count = 0;
  for (MeshWorker& worker : workers_) {
    mesh_count += std::exchange(worker.cached_mesh_count, 0);
    sample_count += std::exchange(worker.cached_sample_count, 0);
  }
  if (AgentMetrics* const metrics = resources_.metrics; metrics != nullptr) {
    metrics->mesh_lookups.hits.Add(mesh_count);
    metrics->mesh_lookups.misses.Add(sample_count + missing_count);
    metrics->sample_lookups.hits.Add(sample_count);
    metrics->sample_lookups.misses.Add(missing_count);
  }
}

// Part 2: reads the blocks of chosen[i], i in `wanted`, each once, and adds their meshes.
absl::Status MeshSupply::AddRead(const std::vector<ChosenMesh>& chosen,
                                 std::vector<std::size_t> wanted, MeshSink* sink,
                                 std::int64_t* read_bytes) {
  const auto block_of = [&](std::size_t i) {
    return BlockToRead{chosen[i].shard_index, chosen[i].ordinal};
  };
  std::sort(wanted.begin(), wanted.end(), [&](std::size_t a, std::size_t b) {
    return std::tuple(block_of(a), chosen[a].surface_index) <
           std::tuple(block_of(b), chosen[b].surface_index);
  });
  std::vector<ColoredBlock> blocks;
  std::vector<std::size_t> first_wanted;  // of each block, in `wanted`; then the end
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    if (blocks.empty() || blocks.back().block != block_of(wanted[i])) {
      blocks.push_back({.block = block_of(wanted[i])});
      first_wanted.push_back(i);
    }
    if (const auto volume = colors_.VolumeOf(chosen[wanted[i]].surface_index)) {
      blocks.back().volumes.set(*volume);
    }
  }
  first_wanted.push_back(wanted.size());
  ISOSCOPE_ASSIGN_OR_RETURN(
      *read_bytes,
      VisitColoredBlocks(
          blocks_.shards(), colors_, blocks, resources_, cancellation_,
          [&](std::size_t block, const volume::BlockSamples& samples,
              std::span<const volume::BlockSamples> fields) {
            const std::size_t begin = first_wanted[block];
            return ExtractRead(chosen,
                               std::span(wanted).subspan(begin, first_wanted[block + 1] - begin),
                               samples, fields, sink);
          },
          {.is_due = [&] { return sink->is_full(); }, .pause = [&] { return sink->Drain(); }}));
  return absl::OkStatus();
}

absl::Status MeshSupply::ExtractRead(const std::vector<ChosenMesh>& chosen,
                                     std::span<const std::size_t> block_meshes,
                                     const volume::BlockSamples& samples,
                                     std::span<const volume::BlockSamples> fields, MeshSink* sink) {
  MeshWorker& worker = workers_.local();
  {
    const base::ScopedTimer timer(&worker.extract_time);
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    for (const std::size_t i : block_meshes) {
      const std::optional<std::size_t> volume = colors_.VolumeOf(chosen[i].surface_index);
      Extract(samples, volume.has_value() ? &fields[*volume] : nullptr, chosen[i], &worker);
    }
    const ChosenMesh& first = chosen[block_meshes.front()];
    resources_.cache->OfferSamples(ShardOf(first), first.ordinal, samples);
  }
  const bool is_worth_it =
      worker.meshes.size() >= kMeshesWorthAdding || worker.mesh_bytes >= MeshWorker::kMaxBatchBytes;
  return is_worth_it ? worker.AddTo(sink, cancellation_, resources_.trace) : absl::OkStatus();
}

absl::Status MeshSupply::AddRest(MeshSink* sink) {
  while (true) {
    base::FirstError error;
    base::RunIn(resources_.arena, [&] {
      tbb::parallel_for(workers_.range(1), [&](const auto& range) {
        for (MeshWorker& worker : range) {
          error.Set(worker.AddTo(sink, cancellation_, resources_.trace));
        }
      });
    });
    ISOSCOPE_RETURN_IF_ERROR(error.status());
    if (std::all_of(workers_.begin(), workers_.end(),
                    [](const MeshWorker& worker) { return worker.meshes.empty(); })) {
      return absl::OkStatus();
    }
    ISOSCOPE_RETURN_IF_ERROR(DrainIfFull(sink));
  }
}

// Threads extract and add in turn. The wall time is divided in proportion to their times.
void MeshSupply::AddUpWorkers(absl::Duration wall, SupplyCost* cost) {
  absl::Duration extract_time;
  absl::Duration add_time;
  for (MeshWorker& worker : workers_) {
    for (std::size_t i = 0; i < worker.surfaces.size(); ++i) {
      cost->surfaces[i] += std::exchange(worker.surfaces[i], {});
    }
    extract_time += std::exchange(worker.extract_time, absl::ZeroDuration());
    add_time += std::exchange(worker.add_time, absl::ZeroDuration());
  }
  const absl::Duration total = extract_time + add_time;
  const double add_share = total > absl::ZeroDuration() ? absl::FDivDuration(add_time, total) : 0.0;
  cost->extract_duration += wall * (1.0 - add_share);
  cost->add_duration += wall * add_share;
}

}  // namespace isoscope::agent
