// The plan is the first one that fits under the limit:
//
//   for sorters and write buffers of full size, of 1/4, of 1/16:
//     portions of 4, 2 or 1 layers, two of them in memory (one if it is the whole volume)
//     portions of 1 layer, one in memory
//   for the first of these sizes with which a row of blocks fits:
//     bands of one layer, as high as fits
//
// With two buffers, the next portion is read while one is cut. Portions of fewer layers read no
// more bytes, because planes that portions share are kept. Rows that bands share are read twice.
//
// Memory follows the phases of partitioning: reading ranges and dealing out (greedy only), writing
// blocks, building the indices of one shard after the other. The total is the source's memory plus
// the largest phase.
//
// Example: 256^3 samples of uint8 in blocks of 8 cells are 32 layers of blocks. A portion of 4
// layers has 4 * 8 + 3 = 35 planes of 64 KiB, 2.2 MiB; two buffers take 4.4 MiB.
//
// Invariant: the bytes that partitioning writes do not depend on the plan.

#include "core/partition/partition_plan.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>

#include "absl/strings/str_format.h"

#include "core/base/memory_info.h"
#include "core/base/units.h"
#include "core/index/interval_tree_builder.h"
#include "core/partition/histogram_builder.h"
#include "core/store/block_order.h"
#include "core/store/shard_format.h"

namespace isoscope::partition {
namespace {

// Portions of several layers take at most this, even if the limit allows more.
constexpr std::int64_t kMaxPortionBytes = base::kGiB;
// The writer takes batches from a short queue, so that neither it nor the cutter waits for single
// ones.
constexpr std::int64_t kBatchBytes = 2 * base::kMiB;
constexpr std::int64_t kBatchesBytes = 8 * base::kMiB;
constexpr std::int64_t kMaxBatchCount = 4;
// Lists of all batches: ids, placements, offsets, spans and checksums of 4 * 4096 blocks.
constexpr std::int64_t kBatchTableBytes = 3 * base::kMiB / 2;
constexpr std::int64_t kBatchTableBytesPerBlock = 128;

// More memory would save merges only when sorting more than about 2^32 bytes. Small limits take a
// share.
constexpr std::int64_t kSortBytes = 8 * base::kMiB;
constexpr int kSortShares[] = {1, 4, 16};
// Sorters have buffers, however few blocks there are.
constexpr std::int64_t kMinTreeBytes = 32 * base::kKiB;
// Bounds of the write buffer of one shard's blocks, and of those of all shards together.
constexpr std::int64_t kMaxFileBufferBytes = 1 * base::kMiB;
constexpr std::int64_t kMinFileBufferBytes = 16 * base::kKiB;
constexpr std::int64_t kFileBuffersBytes = 16 * base::kMiB;
// The write buffer of any other file.
constexpr std::int64_t kFileBufferBytes = 256 * base::kKiB;
// Memory to finish a shard, beside the buffer of its block index: that of its tree's file, and the
// one that computes checksums.
constexpr std::int64_t kFinishingBytes = kFileBufferBytes + base::kMiB;

// Bytes a block of the greedy distribution, beside the ranges: 2 for the shard, 12 for the lists of
// blocks of a class, which grow by doubling.
constexpr std::int64_t kDealingBytesPerBlock = 14;
constexpr std::int64_t kDealtBytesPerBlock = 2;

// Returns a bound of the blocks of the largest shard.
std::int64_t LargestShare(std::int64_t blocks, int shard_count) {
  // The sizes of random shards differ: six standard deviations are enough for all of them.
  const double mean = static_cast<double>(blocks) / shard_count;
  return shard_count == 1
             ? blocks
             : std::min(blocks, static_cast<std::int64_t>(mean + 6 * std::sqrt(mean)) + 1);
}

// Returns the bytes of the largest portion of `layers` layers and `rows` rows of blocks.
std::int64_t PortionBytes(const volume::BlockLayout& layout, volume::ScalarType type,
                          std::int64_t layers, std::int64_t rows) {
  const math::Index3& dims = layout.sample_dims();
  const math::Index3& cells = layout.block_cells();
  return std::min(layers * cells.z + 3, dims.z) * std::min(rows * cells.y + 3, dims.y) * dims.x *
         static_cast<std::int64_t>(volume::SizeOf(type));
}

// Looks for the largest portions that fit under a memory limit.
class Planner {
 public:
  Planner(const volume::BlockLayout& layout, volume::ScalarType type, int shard_count,
          store::Distribution distribution, std::int64_t source_bytes,
          std::int64_t memory_limit_bytes)
      : layout_(layout),
        type_(type),
        sample_size_(static_cast<std::int64_t>(volume::SizeOf(type))),
        shard_count_(shard_count),
        is_greedy_(distribution == store::Distribution::kGreedy),
        source_bytes_(source_bytes),
        memory_limit_bytes_(memory_limit_bytes),
        largest_share_(LargestShare(layout.block_count(), shard_count)) {
    const math::Index3& cells = layout.block_cells();
    const std::int64_t max_block_bytes =
        (cells.x + 3) * (cells.y + 3) * (cells.z + 3) * sample_size_;
    // A small volume is two batches.
    plan_.batch_bytes =
        std::max(max_block_bytes, std::min({kBatchBytes, kMaxBatchBlocks * max_block_bytes,
                                            (layout.block_count() + 1) / 2 * max_block_bytes}));
    plan_.batch_count =
        std::clamp<std::int64_t>(kBatchesBytes / plan_.batch_bytes, 2, kMaxBatchCount);
  }

  [[nodiscard]] const PartitionPlan& plan() const { return plan_; }

  // Plans portions of whole layers. False if one layer does not fit.
  bool PlanLayers() {
    const math::Index3& block_dims = layout_.block_dims();
    for (const int share : kSortShares) {
      TakeShare(share);
      for (const std::int64_t layers : {4, 2, 1}) {
        if (layers > 1 && PortionBytes(layout_, type_, layers, block_dims.y) > kMaxPortionBytes) {
          continue;
        }
        if (Fits(layers, block_dims.y, layers < block_dims.z)) {
          return true;
        }
      }
      if (Fits(1, block_dims.y, false)) {
        return true;
      }
    }
    return false;
  }

  // Plans bands of one layer, as high as fit: the higher, the fewer rows are read twice. False if
  // one row of blocks does not fit; plan().total_bytes is then the limit that is needed.
  bool PlanBands() {
    const bool one_row_fits =
        std::any_of(std::begin(kSortShares), std::end(kSortShares), [&](int share) {
          TakeShare(share);
          return Fits(1, 1, false);
        });
    if (!one_row_fits) {
      return false;
    }
    std::int64_t low = 1;  // fits
    std::int64_t high = layout_.block_dims().y;
    while (high - low > 1) {
      const std::int64_t middle = low + (high - low) / 2;
      (Fits(1, middle, false) ? low : high) = middle;
    }
    return Fits(1, low, false);
  }

 private:
  // Sets the memory of sorters and write buffers to 1 / share of the most that they use.
  void TakeShare(int share) {
    const std::int64_t blocks = layout_.block_count();
    plan_.placement_bytes = std::min(kSortBytes / share, kPlacementBytesPerBlock * blocks);
    plan_.entry_bytes = std::min(kSortBytes / share, kEntryBytesPerBlock * blocks);
    plan_.file_buffer_bytes = std::clamp(
        static_cast<std::int64_t>(
            std::bit_floor(static_cast<std::uint64_t>(kFileBuffersBytes / share / shard_count_))),
        kMinFileBufferBytes, kMaxFileBufferBytes);
    plan_.tree_bytes =
        std::max(index::IntervalTreeBuilder::MemoryBytes(largest_share_) / share, kMinTreeBytes);
  }

  // Sets the portions and computes their memory. True if the step that takes most is under the
  // limit.
  bool Fits(std::int64_t layers, std::int64_t rows, bool is_double_buffered) {
    const std::int64_t blocks = layout_.block_count();
    const std::int64_t dealt_bytes = is_greedy_ ? kDealtBytesPerBlock * blocks : 0;
    const std::int64_t range_bytes = is_greedy_ ? 2 * sample_size_ * blocks : 0;
    plan_.layers_per_portion = layers;
    plan_.block_rows_per_portion = rows;
    plan_.is_double_buffered = is_double_buffered;
    plan_.portion_bytes = PortionBytes(layout_, type_, layers, rows);
    const std::int64_t portions = (is_double_buffered ? 2 : 1) * plan_.portion_bytes;
    const std::int64_t file_bytes = shard_count_ * plan_.file_buffer_bytes + kFileBufferBytes;
    const std::int64_t histogram_bytes = shard_count_ * HistogramBuilder::kBytesPerShard;
    const std::int64_t portion_range_bytes =
        2 * sample_size_ * layers * rows * layout_.block_dims().x;
    const std::int64_t reading_ranges = range_bytes + portions;
    const std::int64_t dealing = range_bytes + (is_greedy_ ? kDealingBytesPerBlock * blocks : 0);
    const std::int64_t writing = dealt_bytes + plan_.placement_bytes + plan_.entry_bytes +
                                 portions + portion_range_bytes + histogram_bytes + file_bytes +
                                 plan_.batch_count * plan_.batch_bytes +
                                 std::min(kBatchTableBytes, kBatchTableBytesPerBlock * blocks);
    const std::int64_t indexing = dealt_bytes + histogram_bytes + plan_.entry_bytes +
                                  plan_.tree_bytes + file_bytes + plan_.file_buffer_bytes +
                                  kFinishingBytes;
    plan_.total_bytes = source_bytes_ + std::max({reading_ranges, dealing, writing, indexing});
    return plan_.total_bytes <= memory_limit_bytes_;
  }

  const volume::BlockLayout& layout_;
  const volume::ScalarType type_;
  const std::int64_t sample_size_;
  const int shard_count_;
  const bool is_greedy_;
  const std::int64_t source_bytes_;
  const std::int64_t memory_limit_bytes_;
  const std::int64_t largest_share_;
  PartitionPlan plan_;
};

}  // namespace

std::int64_t StoredBytes(const volume::BlockLayout& layout, volume::ScalarType type,
                         std::int64_t begin_layer, std::int64_t end_layer) {
  // Extents along an axis do not depend on the other axes.
  const auto sum = [&](int axis, std::int64_t begin, std::int64_t end) {
    std::int64_t samples = 0;
    for (std::int64_t i = begin; i < end; ++i) {
      math::Index3 index{};
      index[axis] = i;
      samples += layout.StoredSamplesOf(layout.IdOf(index)).dims()[axis];
    }
    return samples;
  };
  return sum(0, 0, layout.block_dims().x) * sum(1, 0, layout.block_dims().y) *
         sum(2, begin_layer, end_layer) * static_cast<std::int64_t>(volume::SizeOf(type));
}

std::int64_t CachedBytes() {
  return std::max(static_cast<std::int64_t>(base::UsableBytes() / 8), std::int64_t{base::kGiB});
}

absl::StatusOr<PartitionPlan> PlanPartition(const volume::BlockLayout& layout,
                                            volume::ScalarType type, int shard_count,
                                            store::Distribution distribution,
                                            std::int64_t source_bytes,
                                            std::int64_t memory_limit_bytes) {
  Planner planner(layout, type, shard_count, distribution, source_bytes, memory_limit_bytes);
  if (planner.PlanLayers() || planner.PlanBands()) {
    return planner.plan();
  }
  const math::Index3& dims = layout.sample_dims();
  const math::Index3& cells = layout.block_cells();
  const std::int64_t needed = planner.plan().total_bytes;
  // Other blocks change nothing in what the reader takes.
  const bool is_for_blocks = source_bytes < needed / 2;
  const bool is_greedy = distribution == store::Distribution::kGreedy;
  return absl::InvalidArgumentError(absl::StrFormat(
      "memory limit %d bytes: the reader with its %d bytes and one row of blocks (%d x %d x %d "
      "samples of %s, tables for %d blocks) needs %d bytes; raise --memory-limit%s%s",
      memory_limit_bytes, source_bytes, dims.x, std::min(cells.y + 3, dims.y),
      std::min(cells.z + 3, dims.z), volume::NameOf(type), layout.block_count(), needed,
      is_for_blocks ? ", or use larger blocks" : "",
      is_for_blocks && is_greedy ? " or the random distribution" : ""));
}

absl::Status ValidateShardCount(int shard_count, const volume::BlockLayout& layout) {
  const std::int64_t block_count = layout.block_count();
  const std::int64_t max = std::min<std::int64_t>(store::kMaxShardCount, block_count);
  if (shard_count < 1 || shard_count > max) {
    const math::Index3& cells = layout.block_cells();
    return absl::InvalidArgumentError(absl::StrFormat(
        "%d shards for %d blocks of %d x %d x %d cells: expected 1 to %d; fewer shards, or "
        "smaller blocks",
        shard_count, block_count, cells.x, cells.y, cells.z, max));
  }
  return absl::OkStatus();
}

std::int64_t PortionCount(const volume::BlockLayout& layout, const PartitionPlan& plan) {
  const auto divide_up = [](std::int64_t n, std::int64_t size) { return (n + size - 1) / size; };
  return divide_up(layout.block_dims().z, plan.layers_per_portion) *
         divide_up(layout.block_dims().y, plan.block_rows_per_portion);
}

PortionRange PortionsOf(const volume::BlockLayout& layout, const PartitionPlan& plan,
                        const LayerRange& layers) {
  const std::int64_t bands =
      (layout.block_dims().y + plan.block_rows_per_portion - 1) / plan.block_rows_per_portion;
  const auto portions_below = [&](std::int64_t layer) {
    return (layer + plan.layers_per_portion - 1) / plan.layers_per_portion * bands;
  };
  return {.begin = portions_below(layers.begin), .end = portions_below(layers.end)};
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
