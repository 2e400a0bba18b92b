// Batches of blocks on their way from a portion to the files of the shards. Internal to the
// partitioner, whose tests cover it; the steps are at the head of partitioner.cc.

#ifndef ISOSCOPE_CORE_PARTITION_BLOCK_BATCH_H_
#define ISOSCOPE_CORE_PARTITION_BLOCK_BATCH_H_

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"

#include "core/io/external_sorter.h"
#include "core/math/matrix.h"
#include "core/partition/block_cutter.h"
#include "core/partition/distribution.h"
#include "core/partition/histogram_builder.h"
#include "core/partition/partition_plan.h"
#include "core/store/block_order.h"
#include "core/store/shard_format.h"
#include "core/volume/block_layout.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/scalar_span.h"
#include "core/volume/scalar_type.h"

namespace isoscope::partition {

// Where a block is written. Sorted by position: the order in which blocks are cut.
struct Placement {
  std::int64_t offset = 0;     // in its shard
  std::uint32_t position = 0;  // PositionInPortions
  std::uint32_t ordinal = 0;   // in its shard
  std::uint16_t shard = 0;

  friend bool operator<(const Placement& a, const Placement& b) { return a.position < b.position; }
};
static_assert(sizeof(Placement) == kPlacementBytesPerBlock);

// Blocks that are cut together and then written together, sorted by shard and ordinal.
struct BlockBatch {
  struct Block {
    Placement placement;
    volume::BlockId id = 0;
  };
  std::vector<Block> blocks;
  // By block.
  std::vector<volume::ScalarSpan> spans;
  std::vector<volume::ScalarSpan> finite_spans;  // without infinite samples
  std::vector<double> gradient_magnitudes;       // at least the longest of earlier batches
  std::vector<store::BlockIndexEntry> entries;   // without raw sizes
  std::vector<std::size_t> offsets;              // of each block in `bytes`, and the end
  std::vector<char> bytes;                       // one block after the other

  [[nodiscard]] std::uint16_t ShardAt(std::size_t i) const { return blocks[i].placement.shard; }
};

// The placements of all blocks, taken batch by batch. Thread-compatible.
class PlacementQueue {
 public:
  // References must outlive the queue. Scratch files go to `directory`.
  PlacementQueue(const std::string& directory, const volume::BlockLayout& layout,
                 volume::ScalarType type, const PartitionPlan& plan);

  // Step 2 finds the placement of every block of a slab, as if its shards held these blocks alone.
  // Errors of the scratch file. REQUIRES: `layers` as PortionsOf.
  absl::Status PlaceAll(const ShardMap& shards, const LayerRange& layers);
  // Takes the next blocks and their placements, as many as fit a batch.
  absl::Status Fill(store::BlocksInOrder* blocks, BlockBatch* batch);

 private:
  const volume::BlockLayout& layout_;
  const volume::ScalarType type_;
  const PartitionPlan& plan_;
  io::ExternalSorter<Placement> placements_;
  std::uint32_t next_position_ = 0;
};

// Cuts batches, and measures the samples in them. Thread-compatible; works on many threads.
class BatchCutter {
 public:
  // References must outlive the cutter.
  BatchCutter(const volume::BlockLayout& layout, volume::ScalarType type,
              const volume::GridGeometry& geometry, int shard_count);

  // Copies the batch's blocks out of a slab, finds their spans and longest gradients, and counts
  // their samples.
  void Cut(const Slab& slab, BlockBatch* batch);

  // Returns the longest gradient of the blocks so far.
  [[nodiscard]] double max_gradient_magnitude() const { return max_gradient_magnitude_; }
  [[nodiscard]] const HistogramBuilder& histograms() const { return histograms_; }

 private:
  void CutBlocks(const Slab& slab, BlockBatch* batch) const;
  void CountSamples(const BlockBatch& batch);

  const volume::BlockLayout& layout_;
  const volume::ScalarType type_;
  const math::Mat3d world_gradient_from_index_;
  HistogramBuilder histograms_;
  double max_gradient_magnitude_ = 0;
};

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_BLOCK_BATCH_H_
