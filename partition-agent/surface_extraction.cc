#include "partition-agent/surface_extraction.h"

#include <algorithm>
#include <cstdint>
#include <utility>

#include "absl/status/status.h"

#include "core/base/status_macros.h"
#include "core/volume/block_samples.h"
#include "partition-agent/mesh_supply.h"
#include "partition-agent/surface_blocks.h"

namespace isoscope::agent {

class SurfaceExtraction::Impl {
 public:
  Impl(SurfaceBlocks blocks, const AgentResources& resources,
       const base::Cancellation* cancellation)
      : blocks_(std::move(blocks)),
        cancellation_(*cancellation),
        supply_(&blocks_, /*cache_round=*/0, resources, cancellation),
        chosen_(blocks_.ChooseAll()) {
    std::sort(chosen_.begin(), chosen_.end(),
              [](const ChosenMesh& a, const ChosenMesh& b) { return a.block_id < b.block_id; });
  }

  absl::StatusOr<std::vector<mesh::BlockMesh>> NextBatch() {
    std::vector<mesh::BlockMesh> meshes;
    // All meshes of a batch can be empty: next to NaN, an active block may have no triangle.
    while (meshes.empty() && next_ < chosen_.size()) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
      ISOSCOPE_ASSIGN_OR_RETURN(meshes, supply_.ExtractWithEdgeKeys(TakeBatch()));
      std::erase_if(meshes, [](const mesh::BlockMesh& m) { return m.indices.empty(); });
    }
    return meshes;
  }

 private:
  std::vector<ChosenMesh> TakeBatch() {
    const store::ShardReader& reader = *blocks_.shards().front()->reader;
    std::vector<ChosenMesh> batch;
    std::size_t sample_bytes = 0;
    while (next_ < chosen_.size() && batch.size() < kMaxBatchBlocks &&
           (batch.empty() || sample_bytes < kMaxBatchSampleBytes)) {
      sample_bytes += volume::StoredSizeBytes(reader.layout(), chosen_[next_].block_id,
                                              reader.manifest().scalar_type);
      batch.push_back(chosen_[next_++]);
    }
    return batch;
  }

  const SurfaceBlocks blocks_;
  const base::Cancellation& cancellation_;
  MeshSupply supply_;
  std::vector<ChosenMesh> chosen_;  // ascending by block id
  std::size_t next_ = 0;
};

SurfaceExtraction::SurfaceExtraction(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
SurfaceExtraction::~SurfaceExtraction() = default;

absl::StatusOr<std::unique_ptr<SurfaceExtraction>> SurfaceExtraction::Make(
    std::vector<std::shared_ptr<const Shard>> shards, double isovalue, const view::ClipRegion& clip,
    const AgentResources& resources, const base::Cancellation* cancellation) {
  IndexCost cost;
  ISOSCOPE_ASSIGN_OR_RETURN(
      SurfaceBlocks blocks,
      SurfaceBlocks::Find(std::move(shards), {isovalue}, resources.cache, *cancellation, &cost));
  blocks.EraseOutside(view::Clipper(clip, blocks.shards().front()->reader->manifest().geometry));
  return std::unique_ptr<SurfaceExtraction>(
      new SurfaceExtraction(std::make_unique<Impl>(std::move(blocks), resources, cancellation)));
}

absl::StatusOr<std::vector<mesh::BlockMesh>> SurfaceExtraction::NextBatch() {
  return impl_->NextBatch();
}

}  // namespace isoscope::agent
