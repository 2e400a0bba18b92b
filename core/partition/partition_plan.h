// Divides a volume into portions, of which one or two are in memory at a time. Divides the memory
// of partitioning, so that it stays under its limit.

#ifndef ISOSCOPE_CORE_PARTITION_PARTITION_PLAN_H_
#define ISOSCOPE_CORE_PARTITION_PARTITION_PLAN_H_

#include <cstdint>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/math/box.h"
#include "core/store/manifest.h"
#include "core/volume/block_layout.h"
#include "core/volume/scalar_type.h"

namespace isoscope::partition {

// Portions are whole layers of blocks if these fit; else bands of one layer: a few rows of blocks.
struct PartitionPlan {
  // 1, 2 or 4 layers of blocks. A shard's order goes through cubes of 4 layers
  // (store/block_order.h), so with 4 every shard is written from front to back.
  std::int64_t layers_per_portion = 1;
  std::int64_t block_rows_per_portion = 1;  // block_dims.y: whole planes
  // The next portion is read while this one is cut.
  bool is_double_buffered = false;
  std::int64_t portion_bytes = 0;  // samples of the largest portion
  std::int64_t batch_bytes = 0;    // blocks cut before they are written
  std::int64_t batch_count = 0;    // one is cut, and others are written
  // Memory of the sorters, which spill to disk beyond it.
  std::int64_t placement_bytes = 0;    // placements of all blocks
  std::int64_t entry_bytes = 0;        // spans and checksums of all blocks
  std::int64_t tree_bytes = 0;         // the interval tree of one shard
  std::int64_t file_buffer_bytes = 0;  // write buffer of each shard's blocks
  std::int64_t total_bytes = 0;        // the most that partitioning takes

  // Returns false if planes are too large and portions are bands.
  [[nodiscard]] bool has_whole_planes(const volume::BlockLayout& layout) const {
    return block_rows_per_portion >= layout.block_dims().y;
  }
};

// Returns the bytes of all blocks of some layers as they are stored, ghost samples included.
std::int64_t StoredBytes(const volume::BlockLayout& layout, volume::ScalarType type,
                         std::int64_t begin_layer, std::int64_t end_layer);

// Returns the most bytes of blocks that go through the page cache by default: an eighth of the
// memory that this process may use, at least 1 GiB. The cache keeps these for the first frames. It
// would not keep more, and a copy of them takes longer than many a disk.
std::int64_t CachedBytes();

// INVALID_ARGUMENT unless each shard gets a block, and there are at most kMaxShardCount.
absl::Status ValidateShardCount(int shard_count, const volume::BlockLayout& layout);

// The most blocks of a batch.
inline constexpr std::int64_t kMaxBatchBlocks = 4096;

// Sizes of the records that are sorted, one of each for each block.
inline constexpr std::int64_t kPlacementBytesPerBlock = 24;
inline constexpr std::int64_t kEntryBytesPerBlock = 48;

// Makes the plan with the largest portions that fit. The random distribution takes no memory that
// grows with the blocks; the greedy one takes two samples and 14 bytes a block while it deals
// blocks out, 2 bytes afterwards.
//
// source_bytes: memory of the source, and of all others beside the partitioner
//
// INVALID_ARGUMENT, with the limit that is needed, if not even one row of blocks fits.
absl::StatusOr<PartitionPlan> PlanPartition(const volume::BlockLayout& layout,
                                            volume::ScalarType type, int shard_count,
                                            store::Distribution distribution,
                                            std::int64_t source_bytes,
                                            std::int64_t memory_limit_bytes);

// Layers and rows of blocks [begin, end), over the whole width.
struct Portion {
  std::int64_t begin_layer = 0;
  std::int64_t end_layer = 0;
  std::int64_t begin_row = 0;
  std::int64_t end_row = 0;
};

// Layers of blocks [begin, end): a slab of the volume.
struct LayerRange {
  std::int64_t begin = 0;
  std::int64_t end = 0;

  friend bool operator==(const LayerRange&, const LayerRange&) = default;
};

// Portions [begin, end).
struct PortionRange {
  std::int64_t begin = 0;
  std::int64_t end = 0;
};
// Returns the portions of a slab. REQUIRES: it begins at a multiple of store::kCubeEdge layers, and
// ends at one or with the volume.
PortionRange PortionsOf(const volume::BlockLayout& layout, const PartitionPlan& plan,
                        const LayerRange& layers);

std::int64_t PortionCount(const volume::BlockLayout& layout, const PartitionPlan& plan);
// Returns portion i: ascending by layers, and in a layer by bands.
Portion PortionAt(const volume::BlockLayout& layout, const PartitionPlan& plan, std::int64_t i);
math::IndexBox BlocksOfPortion(const volume::BlockLayout& layout, const Portion& portion);
// Returns the position of the block at `index` in the order in which blocks are cut: portion by
// portion, and in each in the order of store::BlocksInOrder. O(1).
std::int64_t PositionInPortions(const volume::BlockLayout& layout, const PartitionPlan& plan,
                                const math::Index3& index);
// Returns the samples that the blocks of a portion store.
math::IndexBox SamplesOfPortion(const volume::BlockLayout& layout, const Portion& portion);

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_PARTITION_PLAN_H_
