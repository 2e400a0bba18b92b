#include "core/partition/partition_plan.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>

#include "absl/strings/str_format.h"

#include "core/base/units.h"
#include "core/index/interval_tree_builder.h"
#include "core/store/block_order.h"

namespace isoscope::partition {
namespace {

// Portions of several layers take at most this, however much memory is allowed.
constexpr std::int64_t kMaxPortionBytes = base::kGiB;
constexpr std::int64_t kBatchBytes = 4 * base::kMiB;
// Lists of a batch, for both: 8192 blocks' ids, offsets, order, places, spans, checksums.
constexpr std::int64_t kBatchTableBytes = base::kMiB;
constexpr std::int64_t kBatchTableBytesPerBlock = 128;

// More memory for sorting saves merges only beyond about 2^32 bytes; less is for small limits.
constexpr std::int64_t kSortBytes = 8 * base::kMiB;
constexpr int kSortShares[] = {1, 4, 16};
// Sorters have buffers, however few blocks there are.
constexpr std::int64_t kMinTreeBytes = 32 * base::kKiB;
// The buffer of a shard's blocks at most and at least, and of all shards' together.
constexpr std::int64_t kMaxFileBufferBytes = 1 * base::kMiB;
constexpr std::int64_t kMinFileBufferBytes = 16 * base::kKiB;
constexpr std::int64_t kFileBuffersBytes = 16 * base::kMiB;
// That of any other file.
constexpr std::int64_t kFileBufferBytes = 256 * base::kKiB;
// While a shard is finished, beside the buffer of its block index: its tree's file, and what sums
// them up.
constexpr std::int64_t kFinishingBytes = kFileBufferBytes + base::kMiB;

// The greedy distribution, in bytes a block beside the ranges: shard 2, lists of blocks that are
// dealt out together 12 (they grow by doubling).
constexpr std::int64_t kDealingBytesPerBlock = 14;
constexpr std::int64_t kDealtBytesPerBlock = 2;

// Blocks of the largest shard.
std::int64_t LargestShare(std::int64_t blocks, int shard_count) {
  // Shards of a random distribution differ; six standard deviations are enough for all of them.
  const double mean = static_cast<double>(blocks) / shard_count;
  return shard_count == 1
             ? blocks
             : std::min(blocks, static_cast<std::int64_t>(mean + 6 * std::sqrt(mean)) + 1);
}

// The samples of the largest portion of `layers` x `rows` blocks.
std::int64_t PortionBytes(const volume::BlockLayout& layout, volume::ScalarType type,
                          std::int64_t layers, std::int64_t rows) {
  const math::Index3& dims = layout.sample_dims();
  const math::Index3& cells = layout.block_cells();
  return std::min(layers * cells.z + 3, dims.z) * std::min(rows * cells.y + 3, dims.y) * dims.x *
         static_cast<std::int64_t>(volume::SizeOf(type));
}

}  // namespace

absl::StatusOr<PartitionPlan> PlanPartition(const volume::BlockLayout& layout,
                                            volume::ScalarType type, int shard_count,
                                            store::Distribution distribution,
                                            std::int64_t source_bytes,
                                            std::int64_t memory_limit_bytes) {
  const math::Index3& cells = layout.block_cells();
  const math::Index3& block_dims = layout.block_dims();
  const auto sample_size = static_cast<std::int64_t>(volume::SizeOf(type));
  const std::int64_t max_block_bytes = (cells.x + 3) * (cells.y + 3) * (cells.z + 3) * sample_size;
  const std::int64_t blocks = layout.block_count();
  const std::int64_t largest_share = LargestShare(blocks, shard_count);
  const bool is_greedy = distribution == store::Distribution::kGreedy;
  const std::int64_t dealt_bytes = is_greedy ? kDealtBytesPerBlock * blocks : 0;
  const std::int64_t range_bytes = is_greedy ? 2 * sample_size * blocks : 0;
  PartitionPlan plan;
  // A small volume is one batch.
  plan.batch_bytes = std::max(
      max_block_bytes,
      std::min({kBatchBytes, kMaxBatchBlocks * max_block_bytes, blocks * max_block_bytes}));
  const auto fits = [&](std::int64_t layers, std::int64_t rows, bool is_double_buffered) {
    plan.layers_per_portion = layers;
    plan.block_rows_per_portion = rows;
    plan.is_double_buffered = is_double_buffered;
    plan.portion_bytes = PortionBytes(layout, type, layers, rows);
    const std::int64_t portions = (is_double_buffered ? 2 : 1) * plan.portion_bytes;
    const std::int64_t file_bytes = shard_count * plan.file_buffer_bytes + kFileBufferBytes;
    const std::int64_t portion_range_bytes = 2 * sample_size * layers * rows * block_dims.x;
    const std::int64_t reading_ranges = range_bytes + portions;
    const std::int64_t dealing = range_bytes + (is_greedy ? kDealingBytesPerBlock * blocks : 0);
    const std::int64_t writing = dealt_bytes + plan.placement_bytes + plan.entry_bytes + portions +
                                 portion_range_bytes + file_bytes + 2 * plan.batch_bytes +
                                 std::min(kBatchTableBytes, kBatchTableBytesPerBlock * blocks);
    const std::int64_t indexing = dealt_bytes + plan.entry_bytes + plan.tree_bytes + file_bytes +
                                  plan.file_buffer_bytes + kFinishingBytes;
    plan.total_bytes = source_bytes + std::max({reading_ranges, dealing, writing, indexing});
    return plan.total_bytes <= memory_limit_bytes;
  };
  const auto take_share = [&](int share) {
    plan.placement_bytes = std::min(kSortBytes / share, kPlacementBytesPerBlock * blocks);
    plan.entry_bytes = std::min(kSortBytes / share, kEntryBytesPerBlock * blocks);
    plan.file_buffer_bytes = std::clamp(
        static_cast<std::int64_t>(
            std::bit_floor(static_cast<std::uint64_t>(kFileBuffersBytes / share / shard_count))),
        kMinFileBufferBytes, kMaxFileBufferBytes);
    plan.tree_bytes =
        std::max(index::IntervalTreeBuilder::MemoryBytes(largest_share) / share, kMinTreeBytes);
  };
  for (const int share : kSortShares) {
    take_share(share);
    for (const std::int64_t layers : {4, 2, 1}) {
      if (layers > 1 && PortionBytes(layout, type, layers, block_dims.y) > kMaxPortionBytes) {
        continue;
      }
      if (fits(layers, block_dims.y, layers < block_dims.z)) {
        return plan;
      }
    }
    if (fits(1, block_dims.y, false)) {
      return plan;
    }
  }
  // Bands, as high as fit: fewer rows are read twice.
  const bool band_fits =
      std::any_of(std::begin(kSortShares), std::end(kSortShares), [&](int share) {
        take_share(share);
        return fits(1, 1, false);
      });
  if (!band_fits) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "memory limit %d bytes: one row of blocks (%d x %d x %d samples of %s) with tables for %d "
        "blocks needs %d bytes; raise --memory-limit, or use larger blocks%s",
        memory_limit_bytes, layout.sample_dims().x, std::min(cells.y + 3, layout.sample_dims().y),
        std::min(cells.z + 3, layout.sample_dims().z), volume::NameOf(type), blocks,
        plan.total_bytes, is_greedy ? " or the random distribution" : ""));
  }
  std::int64_t low = 1;  // fits
  std::int64_t high = block_dims.y;
  while (high - low > 1) {
    const std::int64_t middle = low + (high - low) / 2;
    (fits(1, middle, false) ? low : high) = middle;
  }
  fits(1, low, false);
  return plan;
}

std::int64_t PortionCount(const volume::BlockLayout& layout, const PartitionPlan& plan) {
  const auto parts = [](std::int64_t n, std::int64_t size) { return (n + size - 1) / size; };
  return parts(layout.block_dims().z, plan.layers_per_portion) *
         parts(layout.block_dims().y, plan.block_rows_per_portion);
}

Portion PortionAt(const volume::BlockLayout& layout, const PartitionPlan& plan, std::int64_t i) {
  const math::Index3& dims = layout.block_dims();
  const std::int64_t bands =
      (dims.y + plan.block_rows_per_portion - 1) / plan.block_rows_per_portion;
  Portion portion;
  portion.begin_layer = i / bands * plan.layers_per_portion;
  portion.end_layer = std::min(portion.begin_layer + plan.layers_per_portion, dims.z);
  portion.begin_row = i % bands * plan.block_rows_per_portion;
  portion.end_row = std::min(portion.begin_row + plan.block_rows_per_portion, dims.y);
  return portion;
}

math::IndexBox BlocksOfPortion(const volume::BlockLayout& layout, const Portion& portion) {
  return {.begin = {0, portion.begin_row, portion.begin_layer},
          .end = {layout.block_dims().x, portion.end_row, portion.end_layer}};
}

std::int64_t PositionInPortions(const volume::BlockLayout& layout, const PartitionPlan& plan,
                                const math::Index3& index) {
  const math::Index3& dims = layout.block_dims();
  const std::int64_t bands =
      (dims.y + plan.block_rows_per_portion - 1) / plan.block_rows_per_portion;
  const Portion portion =
      PortionAt(layout, plan,
                index.z / plan.layers_per_portion * bands + index.y / plan.block_rows_per_portion);
  const std::int64_t layers = portion.end_layer - portion.begin_layer;
  return (portion.begin_layer * dims.y + portion.begin_row * layers) * dims.x +
         store::RankInBox(BlocksOfPortion(layout, portion), index);
}

math::IndexBox SamplesOfPortion(const volume::BlockLayout& layout, const Portion& portion) {
  math::IndexBox box =
      layout.StoredSamplesOf(layout.IdOf({0, portion.begin_row, portion.begin_layer}));
  box.end = layout
                .StoredSamplesOf(layout.IdOf(
                    {layout.block_dims().x - 1, portion.end_row - 1, portion.end_layer - 1}))
                .end;
  return box;
}

}  // namespace isoscope::partition
