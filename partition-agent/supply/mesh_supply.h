// Supplies the meshes of chosen blocks: from the mesh cache, or extracted from samples that are
// cached or read from disk.

#ifndef ISOSCOPE_PARTITION_AGENT_SUPPLY_MESH_SUPPLY_H_
#define ISOSCOPE_PARTITION_AGENT_SUPPLY_MESH_SUPPLY_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include <oneapi/tbb/enumerable_thread_specific.h>

#include "core/base/cancellation.h"
#include "core/frame/agent_statistics.h"
#include "core/volume/block_samples.h"
#include "partition-agent/memory/agent_resources.h"
#include "partition-agent/supply/color_volumes.h"
#include "partition-agent/supply/mesh_worker.h"
#include "partition-agent/supply/surface_blocks.h"

namespace isoscope::agent {

// The cost of the meshes of one step.
struct SupplyCost {
  std::vector<frame::SurfaceStatistics> surfaces;  // by surface index, of meshes that count
  std::int64_t read_bytes = 0;
  // The wall time, divided by the threads' time in reading and extracting, and in the sink.
  absl::Duration extract_duration;
  absl::Duration add_duration;
};

// For one thread at a time. Its arguments outlive it. The shards and surfaces are those of
// `blocks`.
class MeshSupply {
 public:
  // cache_round: the result of BlockCache::BeginRound for the frame.
  // keeps_gradient_magnitudes: by surface, whether vertices have them as values; or empty
  // colors: the volumes whose samples are the values of the others' vertices
  MeshSupply(const SurfaceBlocks* blocks, std::uint64_t cache_round,
             const AgentResources& resources, const base::Cancellation* cancellation,
             std::vector<bool> keeps_gradient_magnitudes = {}, ColorVolumes colors = {});

  // Adds each chosen mesh to `sink` once, some at a time, in any order, on several threads of the
  // arena at once. Each block is read at most once. A full sink is drained before it takes more
  // than one batch of each thread: kMaxBatchMeshes meshes, and at most one of them after
  // kMaxBatchBytes. Returns when all were added, or the first error: of the sink, of the
  // cancellation (within one block), DATA_LOSS as ShardReader::VisitDiskRun, FAILED_PRECONDITION as
  // ColorVolumes::CheckBlock. Blocks.
  absl::StatusOr<SupplyCost> AddMeshes(const std::vector<ChosenMesh>& chosen, MeshSink* sink);

  // Removes the meshes that the cache has, without using them.
  void EraseCached(std::vector<ChosenMesh>* chosen);

 private:
  [[nodiscard]] const Shard& ShardOf(const ChosenMesh& mesh) const {
    return *blocks_.shards()[mesh.shard_index];
  }
  [[nodiscard]] MeshTable& TableOf(const ChosenMesh& mesh) const {
    return *tables_[mesh.shard_index * blocks_.rules().size() + mesh.surface_index];
  }

  [[nodiscard]] MeshValues ValuesOf(std::size_t shard_index, std::size_t surface_index) const;
  void OpenTables();
  [[nodiscard]] absl::Status CheckColors(const std::vector<ChosenMesh>& chosen) const;
  absl::Status AddCached(const std::vector<ChosenMesh>& chosen, std::vector<char>* is_missing,
                         MeshSink* sink);
  absl::Status FindAndAdd(std::span<const ChosenMesh> chosen, std::span<char> is_missing,
                          MeshSink* sink);
  bool Find(const ChosenMesh& chosen, MeshWorker* worker);
  void Extract(const volume::BlockSamples& samples, const volume::BlockSamples* field,
               const ChosenMesh& chosen, MeshWorker* worker);
  void CountLookups(std::int64_t missing_count);
  absl::Status AddRead(const std::vector<ChosenMesh>& chosen, std::vector<std::size_t> wanted,
                       MeshSink* sink, std::int64_t* read_bytes);
  absl::Status ExtractRead(const std::vector<ChosenMesh>& chosen,
                           std::span<const std::size_t> block_meshes,
                           const volume::BlockSamples& samples,
                           std::span<const volume::BlockSamples> fields, MeshSink* sink);
  absl::Status AddRest(MeshSink* sink);
  void AddUpWorkers(absl::Duration wall, SupplyCost* cost);

  const SurfaceBlocks& blocks_;
  const AgentResources resources_;
  const base::Cancellation& cancellation_;
  const std::uint64_t round_;
  std::vector<bool> keeps_gradient_magnitudes_;  // by surface
  const ColorVolumes colors_;
  std::vector<std::shared_ptr<MeshTable>> tables_;  // by shard, surface
  tbb::enumerable_thread_specific<MeshWorker> workers_;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_SUPPLY_MESH_SUPPLY_H_
