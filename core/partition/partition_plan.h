// How a volume is taken through memory in portions, so that partitioning stays under its limit.

#ifndef ISOSCOPE_CORE_PARTITION_PARTITION_PLAN_H_
#define ISOSCOPE_CORE_PARTITION_PARTITION_PLAN_H_

#include <cstdint>

#include "absl/status/statusor.h"

#include "core/math/box.h"
#include "core/store/manifest.h"
#include "core/volume/block_layout.h"
#include "core/volume/scalar_type.h"

namespace isoscope::partition {

// Whole layers of blocks while they fit; else bands of one layer, a few rows of blocks each.
struct PartitionPlan {
  // 1, 2 or 4: of the cubes that follow one another in a shard (store/block_order.h) so many
  // layers are cut at a time. With 4 every shard is written from the front to the back.
  std::int64_t layers_per_portion = 1;
  std::int64_t block_rows_per_portion = 1;  // block_dims.y: whole planes
  // The next portion is read while this one is cut.
  bool is_double_buffered = false;
  std::int64_t portion_bytes = 0;  // samples of the largest portion
  std::int64_t batch_bytes = 0;    // blocks cut before they are written; there are two batches
  // What grows with the number of blocks is sorted on disk beyond these:
  std::int64_t placement_bytes = 0;    // where each block goes
  std::int64_t entry_bytes = 0;        // span and checksum of each block
  std::int64_t tree_bytes = 0;         // the interval tree of one shard
  std::int64_t file_buffer_bytes = 0;  // of each shard's blocks, before they are written
  std::int64_t total_bytes = 0;        // that partitioning takes, at most

  // False if planes are too large: portions are bands.
  [[nodiscard]] bool has_whole_planes(const volume::BlockLayout& layout) const {
    return block_rows_per_portion >= layout.block_dims().y;
  }
};

// Blocks that a batch has at most.
inline constexpr std::int64_t kMaxBatchBlocks = 8192;

// What is sorted, for each block.
inline constexpr std::int64_t kPlacementBytesPerBlock = 24;
inline constexpr std::int64_t kEntryBytesPerBlock = 32;

// `source_bytes`: what the source holds, and others beside the partitioner. The random distribution
// takes no memory a block; the greedy one its ranges (two samples) and 14 bytes while it deals
// blocks out, 2 bytes afterwards. INVALID_ARGUMENT if not even one row of blocks fits under the
// limit beside that: says what is needed.
absl::StatusOr<PartitionPlan> PlanPartition(const volume::BlockLayout& layout,
                                            volume::ScalarType type, int shard_count,
                                            store::Distribution distribution,
                                            std::int64_t source_bytes,
                                            std::int64_t memory_limit_bytes);

// Blocks [begin, end) of layers and rows, over the whole width.
struct Portion {
  std::int64_t begin_layer = 0;
  std::int64_t end_layer = 0;
  std::int64_t begin_row = 0;
  std::int64_t end_row = 0;
};

std::int64_t PortionCount(const volume::BlockLayout& layout, const PartitionPlan& plan);
// The i-th portion: bands of a layer first, then layers, ascending.
Portion PortionAt(const volume::BlockLayout& layout, const PartitionPlan& plan, std::int64_t i);
math::IndexBox BlocksOfPortion(const volume::BlockLayout& layout, const Portion& portion);
// Blocks are cut portion by portion, those of each in the order of store::BlocksInOrder. The place
// in that sequence of the block at `index`.
std::int64_t PositionInPortions(const volume::BlockLayout& layout, const PartitionPlan& plan,
                                const math::Index3& index);
// The samples that its blocks store.
math::IndexBox SamplesOfPortion(const volume::BlockLayout& layout, const Portion& portion);

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_PARTITION_PLAN_H_
