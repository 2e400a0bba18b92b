// Assigns blocks to shards.

#ifndef ISOSCOPE_CORE_PARTITION_DISTRIBUTION_H_
#define ISOSCOPE_CORE_PARTITION_DISTRIBUTION_H_

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "core/store/sample_reader.h"
#include "core/volume/block_layout.h"
#include "core/volume/range_table.h"

namespace isoscope::partition {

// The units of an index-only volume, each of the blocks whose first sample it has. They are numbered
// from 0 without a gap, those without a block left out. Immutable; thread-safe.
class BlockUnits {
 public:
  BlockUnits(const volume::BlockLayout& layout, const store::SourceSamples& samples);

  [[nodiscard]] std::int64_t unit_count() const { return math::Volume(dims_); }
  // REQUIRES: id < layout.block_count().
  [[nodiscard]] std::uint32_t UnitOf(volume::BlockId id) const;

 private:
  volume::BlockLayout layout_;
  math::Index3 dims_;
  std::array<std::vector<std::uint32_t>, 3> units_;  // by axis and index of the block
};

// The shard of every block. Immutable; thread-safe.
class ShardMap {
 public:
  // The map of DistributeRandomly; a shard is computed when it is asked for. O(block_count) time,
  // O(shard_count) memory.
  static ShardMap Random(std::int64_t block_count, int shard_count, std::uint64_t seed);
  // The same of units: blocks of one unit are in one shard. REQUIRES: shard_count <= unit_count().
  static ShardMap RandomUnits(BlockUnits units, int shard_count, std::uint64_t seed);
  // The map of DistributeGreedily: a table of 2 bytes a block.
  static ShardMap Greedy(const volume::RangeTable& ranges, int shard_count);

  // REQUIRES: id < block_count.
  [[nodiscard]] std::uint16_t ShardOf(volume::BlockId id) const;
  [[nodiscard]] int shard_count() const { return shard_count_; }

 private:
  explicit ShardMap(int shard_count) : shard_count_(shard_count) {}

  // Draws a shard from (seed, id) alone.
  [[nodiscard]] std::uint16_t Draw(volume::BlockId id) const;

  std::vector<BlockUnits> units_;  // one, or none: ids are those of blocks
  int shard_count_;
  std::uint64_t seed_ = 0;
  std::vector<std::pair<volume::BlockId, std::uint16_t>> moved_;  // random: ascending by id
  std::vector<std::uint16_t> table_;                              // greedy: by id
};

// Both functions return the shard of each block, by block id, and leave no shard empty.
// REQUIRES: 1 <= shard_count <= min(block_count, store::kMaxShardCount).

// Independent Bernoulli trials: each block goes to a shard drawn from (seed, id) alone, so its
// shard does not depend on any other block. Shards may stay empty, which is likely only with few
// blocks a shard. Then the first blocks by id that are not alone in their shard move into the empty
// shards, in ascending order. O(block_count). Source: Zhang, Bajaj, Ramachandran 2002, section 2.1
// (references.bib: zhang-random-distribution).
std::vector<std::uint16_t> DistributeRandomly(std::int64_t block_count, int shard_count,
                                              std::uint64_t seed);

// Balances, for every isovalue, the number of active blocks of the shards (the workload histogram).
// Deterministic; the steps are at the head of distribution.cc.
// O(block_count + bins^3 * shard_count), bins = 128 (32 above 1024 shards).
// Source: Zhang, Bajaj, Blanke 2001, "Scalable isosurface visualization of massive datasets on COTS
// clusters", and Zhang, Bajaj, Ramachandran 2002, section 2.2 (zhang-random-distribution).
std::vector<std::uint16_t> DistributeGreedily(const volume::RangeTable& ranges, int shard_count);

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_DISTRIBUTION_H_
