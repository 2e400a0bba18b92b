#include "core/partition/block_batch.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/types/span.h"
#include "oneapi/tbb/parallel_for.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/extract/gradient_bound.h"
#include "core/volume/block_samples.h"
#include "core/volume/sample_histogram.h"

namespace isoscope::partition {
namespace {

// The number of blocks of a shard that one task counts: so many that adding up its bins costs
// little.
constexpr std::size_t kBlocksPerCount = 64;

}  // namespace

PlacementQueue::PlacementQueue(const std::string& directory, const volume::BlockLayout& layout,
                               volume::ScalarType type, const PartitionPlan& plan)
    : layout_(layout), type_(type), plan_(plan), placements_(directory, plan.placement_bytes) {}

absl::Status PlacementQueue::PlaceAll(const ShardMap& shards, const LayerRange& layers) {
  const math::Index3& dims = layout_.block_dims();
  next_position_ = static_cast<std::uint32_t>(layers.begin * dims.y * dims.x);
  if (layers.begin == layers.end) {
    return placements_.Finish();
  }
  // By shard: the placement of its next block.
  std::vector<Placement> next(static_cast<std::size_t>(shards.shard_count()));
  for (store::BlocksInOrder blocks(
           {.begin = {0, 0, layers.begin}, .end = {dims.x, dims.y, layers.end}});
       !blocks.is_at_end(); blocks.Next()) {
    const volume::BlockId id = layout_.IdOf(blocks.index());
    const std::uint16_t shard = shards.ShardOf(id);
    Placement& placement = next[shard];
    placement.shard = shard;
    placement.position =
        static_cast<std::uint32_t>(PositionInPortions(layout_, plan_, blocks.index()));
    ISOSCOPE_RETURN_IF_ERROR(placements_.Add(placement));
    ++placement.ordinal;
    placement.offset += static_cast<std::int64_t>(volume::StoredSizeBytes(layout_, id, type_));
  }
  return placements_.Finish();
}

absl::Status PlacementQueue::Fill(store::BlocksInOrder* blocks, BlockBatch* batch) {
  batch->bytes.resize(static_cast<std::size_t>(plan_.batch_bytes));
  batch->blocks.clear();
  std::size_t size = 0;
  for (; !blocks->is_at_end() && static_cast<std::int64_t>(batch->blocks.size()) < kMaxBatchBlocks;
       blocks->Next()) {
    const volume::BlockId id = layout_.IdOf(blocks->index());
    size += volume::StoredSizeBytes(layout_, id, type_);
    if (size > batch->bytes.size()) {
      break;
    }
    ISOSCOPE_CHECK(!placements_.is_at_end());
    ISOSCOPE_CHECK_EQ(placements_.current().position, next_position_);
    ++next_position_;
    batch->blocks.push_back({.placement = placements_.current(), .id = id});
    ISOSCOPE_RETURN_IF_ERROR(placements_.Advance());
  }
  const auto key_of = [](const BlockBatch::Block& block) {
    return std::pair(block.placement.shard, block.placement.ordinal);
  };
  std::sort(batch->blocks.begin(), batch->blocks.end(),
            [&](const BlockBatch::Block& a, const BlockBatch::Block& b) {
              return key_of(a) < key_of(b);
            });
  batch->offsets.assign(1, 0);
  for (const BlockBatch::Block& block : batch->blocks) {
    batch->offsets.push_back(batch->offsets.back() +
                             volume::StoredSizeBytes(layout_, block.id, type_));
  }
  batch->spans.resize(batch->blocks.size());
  batch->finite_spans.resize(batch->blocks.size());
  batch->gradient_magnitudes.resize(batch->blocks.size());
  batch->entries.resize(batch->blocks.size());
  return absl::OkStatus();
}

BatchCutter::BatchCutter(const volume::BlockLayout& layout, volume::ScalarType type,
                         const volume::GridGeometry& geometry, int shard_count)
    : layout_(layout),
      type_(type),
      world_gradient_from_index_(geometry.world_gradient_from_index()),
      histograms_(layout, type, shard_count) {}

void BatchCutter::Cut(const Slab& slab, BlockBatch* batch) {
  CutBlocks(slab, batch);
  for (const double magnitude : batch->gradient_magnitudes) {
    max_gradient_magnitude_ = std::max(max_gradient_magnitude_, magnitude);
  }
  CountSamples(*batch);
}

void BatchCutter::CutBlocks(const Slab& slab, BlockBatch* batch) const {
  tbb::parallel_for(std::size_t{0}, batch->blocks.size(), [&](std::size_t i) {
    const volume::BlockId id = batch->blocks[i].id;
    char* const bytes = batch->bytes.data() + batch->offsets[i];
    CutBlock(layout_, type_, slab, id, bytes);
    // From here on the block is read from the cache, not from the slab's far rows.
    const volume::BlockSamples samples{.block_id = id, .type = type_, .bytes = bytes};
    const volume::ScalarSpan span = SpanOfBlock(layout_, samples);
    batch->spans[i] = span;
    batch->finite_spans[i] = std::isfinite(span.min) && std::isfinite(span.max)
                                 ? span
                                 : FiniteSpanOfBlock(layout_, samples);
    // Each sample counts in one block alone.
    batch->gradient_magnitudes[i] = extract::MaxGradientMagnitude(
        layout_, world_gradient_from_index_, samples, volume::CountedSamplesOf(layout_, id),
        max_gradient_magnitude_);
  });
}

void BatchCutter::CountSamples(const BlockBatch& batch) {
  std::vector<volume::BlockSamples> blocks(batch.blocks.size());
  std::vector<std::size_t> begins;  // of the tasks, and the end
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    blocks[i] = {.block_id = batch.blocks[i].id,
                 .type = type_,
                 .bytes = batch.bytes.data() + batch.offsets[i]};
    histograms_.Cover(batch.finite_spans[i]);
    if (i == 0 || i - begins.back() == kBlocksPerCount ||
        batch.ShardAt(i) != batch.ShardAt(i - 1)) {
      begins.push_back(i);
    }
  }
  begins.push_back(blocks.size());
  tbb::parallel_for(std::size_t{0}, begins.size() - 1, [&](std::size_t task) {
    histograms_.Count(
        batch.ShardAt(begins[task]),
        absl::MakeConstSpan(blocks).subspan(begins[task], begins[task + 1] - begins[task]));
  });
}

}  // namespace isoscope::partition
