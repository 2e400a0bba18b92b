// Delivers the meshes of chosen blocks: kept ones from the mesh cache, others extracted from
// samples that are kept or read from disk. Frames draw what is delivered, exports send it.

#ifndef ISOSCOPE_PARTITION_AGENT_MESH_SUPPLY_H_
#define ISOSCOPE_PARTITION_AGENT_MESH_SUPPLY_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "core/base/cancellation.h"
#include "core/frame/agent_statistics.h"
#include "core/mesh/block_mesh.h"
#include "core/render/renderer.h"
#include "partition-agent/agent_resources.h"
#include "partition-agent/surface_blocks.h"

namespace isoscope::agent {

// The cost of a delivery.
struct SupplyCost {
  std::vector<frame::SurfaceStatistics> surfaces;  // by surface index
  std::int64_t read_bytes = 0;
  // The wall time, shared out by the threads' time in reading and extracting, and in the sink.
  absl::Duration extract_duration;
  absl::Duration deliver_duration;
};

// Takes the meshes of a delivery.
class MeshSink {
 public:
  virtual ~MeshSink() = default;
  // Takes meshes, on several threads of the arena at once. Runs no parallel loop.
  virtual absl::Status Take(std::span<const render::MeshToDraw> meshes) = 0;
  // Returns true if it holds as much as it may. Thread-safe.
  [[nodiscard]] virtual bool is_full() const = 0;
  // Lets go of what it holds. Called by the thread of the delivery, while nothing is taken and no
  // lock is held.
  virtual absl::Status Drain() = 0;
};

// For one thread at a time. Its arguments outlive it. The shards and surfaces are those of
// `blocks`.
class MeshSupply {
 public:
  // cache_round: the result of BlockCache::BeginRound for the frame.
  // keeps_gradient_magnitudes: by surface, whether meshes that are delivered have them; or empty
  MeshSupply(const SurfaceBlocks* blocks, std::uint64_t cache_round,
             const AgentResources& resources, const base::Cancellation* cancellation,
             std::vector<bool> keeps_gradient_magnitudes = {});
  ~MeshSupply();
  MeshSupply(const MeshSupply&) = delete;
  MeshSupply& operator=(const MeshSupply&) = delete;

  // Gives each chosen mesh to `sink` once, some at a time, in any order, on several threads of the
  // arena at once. Each block is read at most once. A full sink is drained before it takes more
  // than one delivery of each thread: kMaxDeliveryMeshes meshes, and at most one of them after
  // kMaxDeliveryBytes. Returns when all were delivered, or the first error: of the sink, of the
  // cancellation (within one block), DATA_LOSS as ShardReader::VisitDiskRun. Blocks.
  static constexpr std::size_t kMaxDeliveryMeshes = 64;
  static constexpr std::size_t kMaxDeliveryBytes = std::size_t{256} << 10;
  absl::StatusOr<SupplyCost> DeliverMeshes(const std::vector<ChosenMesh>& chosen, MeshSink* sink);

  // Extracts the mesh of chosen[i] as element i, with edge keys. Errors as DeliverMeshes.
  absl::StatusOr<std::vector<mesh::BlockMesh>> ExtractWithEdgeKeys(
      const std::vector<ChosenMesh>& chosen);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_MESH_SUPPLY_H_
