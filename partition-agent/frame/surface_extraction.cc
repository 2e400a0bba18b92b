#include "partition-agent/frame/surface_extraction.h"

#include <algorithm>
#include <numeric>
#include <tuple>
#include <utility>

#include "absl/status/status.h"

#include "core/base/status_macros.h"
#include "core/volume/block_samples.h"
#include "partition-agent/supply/block_reads.h"

namespace isoscope::agent {
namespace {

// Returns the blocks that have a part of the closed surface. Errors are those of pages of spans.
absl::StatusOr<std::vector<ChosenMesh>> ChooseForClosing(const SurfaceBlocks& blocks,
                                                         const solid::SurfaceOptions& options,
                                                         const base::Cancellation& cancellation) {
  const store::ShardReader& first = *blocks.shards().front()->reader;
  const view::Clipper clipper(options.clip, first.manifest().geometry);
  std::vector<ChosenMesh> chosen;
  for (std::uint32_t shard = 0; shard < blocks.shards().size(); ++shard) {
    const store::ShardReader& reader = *blocks.shards()[shard]->reader;
    volume::BlockSpans spans = reader.Spans();
    for (std::uint32_t ordinal = 0; ordinal < reader.block_count(); ++ordinal) {
      const volume::BlockId id = reader.block_id(ordinal);
      if (solid::MayHaveSurface(first.layout(), id, &spans, blocks.rules().front(), clipper)) {
        chosen.push_back({.block_id = id, .ordinal = ordinal, .shard_index = shard});
      }
    }
    ISOSCOPE_RETURN_IF_ERROR(spans.status());
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
  }
  return chosen;
}

}  // namespace

absl::StatusOr<std::unique_ptr<SurfaceExtraction>> SurfaceExtraction::Make(
    Shards shards, const volume::InsideRule& rule, const solid::SurfaceOptions& options,
    const AgentResources& resources, const base::Cancellation* cancellation) {
  IndexCost cost;
  ISOSCOPE_ASSIGN_OR_RETURN(
      SurfaceBlocks blocks,
      SurfaceBlocks::Find(std::move(shards), {rule}, resources.cache, *cancellation, &cost));
  blocks.EraseOutside(
      view::Clipper(options.clip, blocks.shards().front()->reader->manifest().geometry));
  std::vector<ChosenMesh> chosen;
  if (options.closes) {
    ISOSCOPE_ASSIGN_OR_RETURN(chosen, ChooseForClosing(blocks, options, *cancellation));
  } else {
    chosen = blocks.ChooseAll();
  }
  return std::unique_ptr<SurfaceExtraction>(new SurfaceExtraction(
      std::move(blocks), options, resources, cancellation, std::move(chosen)));
}

SurfaceExtraction::SurfaceExtraction(SurfaceBlocks blocks, const solid::SurfaceOptions& options,
                                     const AgentResources& resources,
                                     const base::Cancellation* cancellation,
                                     std::vector<ChosenMesh> chosen)
    : blocks_(std::move(blocks)),
      resources_(resources),
      cancellation_(*cancellation),
      chosen_(std::move(chosen)),
      extractors_([this, options] {
        const Shard& shard = *blocks_.shards().front();
        return solid::BlockSurface(shard.reader->manifest().geometry, shard.reader->layout(),
                                   shard.shapes, options);
      }) {
  std::sort(chosen_.begin(), chosen_.end(),
            [](const ChosenMesh& a, const ChosenMesh& b) { return a.block_id < b.block_id; });
}

solid::SurfaceSums SurfaceExtraction::sums() const {
  solid::SurfaceSums sums;
  for (const solid::SurfaceSums& part : sums_) {
    sums.Add(part);
  }
  return sums;
}

absl::StatusOr<bool> SurfaceExtraction::NextBatch(std::vector<mesh::BlockMesh>* meshes) {
  meshes->clear();
  if (next_ == chosen_.size()) {
    return false;
  }
  ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
  ISOSCOPE_ASSIGN_OR_RETURN(*meshes, Extract(ChooseBatch()));
  std::erase_if(*meshes, [](const mesh::BlockMesh& m) { return m.indices.empty(); });
  return true;
}

std::span<const ChosenMesh> SurfaceExtraction::ChooseBatch() {
  const store::ShardReader& reader = *blocks_.shards().front()->reader;
  const std::size_t begin = next_;
  std::size_t sample_bytes = 0;
  while (next_ < chosen_.size() && next_ - begin < kMaxBatchBlocks &&
         (next_ == begin || sample_bytes < kMaxBatchSampleBytes)) {
    sample_bytes += volume::StoredSizeBytes(reader.layout(), chosen_[next_++].block_id,
                                            reader.manifest().scalar_type);
  }
  return std::span(chosen_).subspan(begin, next_ - begin);
}

// Returns the mesh of batch[i] as element i.
absl::StatusOr<std::vector<mesh::BlockMesh>> SurfaceExtraction::Extract(
    std::span<const ChosenMesh> batch) {
  const auto block_of = [&](std::size_t i) {
    return BlockToRead{batch[i].shard_index, batch[i].ordinal};
  };
  std::vector<std::size_t> order(batch.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return block_of(a) < block_of(b); });
  std::vector<BlockToRead> blocks(batch.size());
  std::transform(order.begin(), order.end(), blocks.begin(), block_of);
  std::vector<mesh::BlockMesh> meshes(batch.size());
  ISOSCOPE_RETURN_IF_ERROR(
      BlockReads(blocks_.shards(), blocks)
          .ForEach(resources_, cancellation_,
                   [&](std::size_t block, const volume::BlockSamples& samples) {
                     extractors_.local().Extract(samples, blocks_.rules().front(),
                                                 &meshes[order[block]], &sums_.local());
                     return cancellation_.Check();
                   }));
  return meshes;
}

}  // namespace isoscope::agent
