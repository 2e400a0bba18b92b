// Extracts the whole surface of an agent's shards, block by block, for ExtractSurface, as exports
// have it (core/solid). No gRPC types.

#ifndef ISOSCOPE_PARTITION_AGENT_FRAME_SURFACE_EXTRACTION_H_
#define ISOSCOPE_PARTITION_AGENT_FRAME_SURFACE_EXTRACTION_H_

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "absl/status/statusor.h"
#include <oneapi/tbb/enumerable_thread_specific.h>

#include "core/base/cancellation.h"
#include "core/mesh/block_mesh.h"
#include "core/solid/block_surface.h"
#include "core/solid/surface_sums.h"
#include "core/volume/inside_rule.h"
#include "partition-agent/memory/agent_resources.h"
#include "partition-agent/shard/shard.h"
#include "partition-agent/supply/surface_blocks.h"

namespace isoscope::agent {

// Walks the blocks of all shards that have a part of the surface, in ascending order of block ids,
// in batches. The arena reads and extracts the blocks of a batch in parallel, when NextBatch asks
// for it. Memory holds the meshes of one batch, whose samples take at most kMaxBatchSampleBytes (or
// one block), and the reads under way, at most resources.max_read_bytes (or one disk run).
// Thread-compatible. Its arguments must outlive it.
class SurfaceExtraction {
 public:
  // `shards`: of one dataset, at least one. Errors as SurfaceBlocks::Find. Blocks wholly outside of
  // the clip region are left out. REQUIRES: an isovalue is finite.
  static absl::StatusOr<std::unique_ptr<SurfaceExtraction>> Make(
      Shards shards, const volume::InsideRule& rule, const solid::SurfaceOptions& options,
      const AgentResources& resources, const base::Cancellation* cancellation);

  // Replaces `meshes` by those of the next batch, ascending; blocks without triangles are left out,
  // which may be all: next to NaN, an active block may have none. False at the end. Errors:
  // DATA_LOSS as ShardReader::ReadDiskRun; CANCELLED, DEADLINE_EXCEEDED. Blocks.
  absl::StatusOr<bool> NextBatch(std::vector<mesh::BlockMesh>* meshes);

  // Returns the sums over all batches so far.
  [[nodiscard]] solid::SurfaceSums sums() const;

  static constexpr std::size_t kMaxBatchSampleBytes = 16 << 20;
  static constexpr std::size_t kMaxBatchBlocks = 1024;

 private:
  SurfaceExtraction(SurfaceBlocks blocks, const solid::SurfaceOptions& options,
                    const AgentResources& resources, const base::Cancellation* cancellation,
                    std::vector<ChosenMesh> chosen);
  absl::StatusOr<std::vector<mesh::BlockMesh>> Extract(std::span<const ChosenMesh> batch);
  std::span<const ChosenMesh> ChooseBatch();

  const SurfaceBlocks blocks_;
  const AgentResources resources_;
  const base::Cancellation& cancellation_;
  std::vector<ChosenMesh> chosen_;  // ascending by block id
  std::size_t next_ = 0;
  tbb::enumerable_thread_specific<solid::BlockSurface> extractors_;
  tbb::enumerable_thread_specific<solid::SurfaceSums> sums_;  // parts
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_FRAME_SURFACE_EXTRACTION_H_
