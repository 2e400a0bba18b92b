// The meshes that one thread of a MeshSupply collects, and their way into the sink.

#ifndef ISOSCOPE_PARTITION_AGENT_SUPPLY_MESH_WORKER_H_
#define ISOSCOPE_PARTITION_AGENT_SUPPLY_MESH_WORKER_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"

#include "core/base/cancellation.h"
#include "core/base/trace_recorder.h"
#include "core/extract/block_extractor.h"
#include "core/frame/agent_statistics.h"
#include "core/render/renderer.h"
#include "partition-agent/cache/mesh_cache.h"
#include "partition-agent/shard/shard.h"
#include "partition-agent/supply/surface_blocks.h"

namespace isoscope::agent {

// Destination of a supply's meshes.
class MeshSink {
 public:
  virtual ~MeshSink() = default;
  // Adds meshes, on several threads of the arena at once. Runs no parallel loop.
  virtual absl::Status Add(std::span<const render::MeshToDraw> meshes) = 0;
  // Returns true if it holds its maximum. Thread-safe.
  [[nodiscard]] virtual bool is_full() const = 0;
  // Releases the held meshes. Called by the thread of the supply, while no meshes are added and no
  // lock is held.
  virtual absl::Status Drain() = 0;
};

// For one thread at a time. It keeps its state between tasks.
struct MeshWorker {
  // The most meshes of a batch, and the bytes after which one mesh ends it.
  static constexpr std::size_t kMaxBatchMeshes = 64;
  static constexpr std::size_t kMaxBatchBytes = std::size_t{256} << 10;

  MeshWorker(const Shard& shard, MeshCache* cache, std::uint64_t round, std::size_t surface_count)
      : extractor(shard.reader->manifest().geometry, shard.reader->layout(), shard.shapes),
        writer(cache, round),
        surfaces(surface_count) {}

  void Collect(std::shared_ptr<const mesh::CompactMesh> mesh, const ChosenMesh& chosen) {
    if (chosen.counts) {
      surfaces[chosen.surface_index] += {.triangle_count = mesh->triangle_count(),
                                         .unique_vertex_count = mesh->owned_vertex_count};
    }
    meshes.push_back({std::move(mesh), chosen.surface_index, chosen.open});
  }

  // Adds the collected meshes to the sink, a batch at a time, so that a cancelled frame ends soon.
  // Keeps the rest if the sink is full. Errors: of the sink, of the cancellation.
  absl::Status AddTo(MeshSink* sink, const base::Cancellation& cancellation,
                     base::TraceRecorder* trace);

  extract::BlockExtractor extractor;
  MeshCache::Writer writer;
  std::vector<render::MeshToDraw> meshes;  // collected, not yet added
  std::size_t mesh_bytes = 0;              // of those extracted since meshes were last added
  std::vector<frame::SurfaceStatistics> surfaces;
  absl::Duration extract_time;
  absl::Duration add_time;
  std::int64_t cached_mesh_count = 0;
  std::int64_t cached_sample_count = 0;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_SUPPLY_MESH_WORKER_H_
