// Which shard gets which block.

#ifndef ISOSCOPE_CORE_PARTITION_DISTRIBUTION_H_
#define ISOSCOPE_CORE_PARTITION_DISTRIBUTION_H_

#include <cstdint>
#include <utility>
#include <vector>

#include "core/volume/range_table.h"

namespace isoscope::partition {

// The shard of every block. Immutable; thread-safe.
class ShardMap {
 public:
  // As DistributeRandomly, computed when asked for. O(block_count) time, O(shard_count) memory.
  static ShardMap Random(std::int64_t block_count, int shard_count, std::uint64_t seed);
  // As DistributeGreedily: a table of 2 bytes a block.
  static ShardMap Greedy(const volume::RangeTable& ranges, int shard_count);

  // REQUIRES: id < block_count.
  [[nodiscard]] std::uint16_t ShardOf(volume::BlockId id) const;
  [[nodiscard]] int shard_count() const { return shard_count_; }

 private:
  explicit ShardMap(int shard_count) : shard_count_(shard_count) {}

  // What (seed, id) alone say.
  [[nodiscard]] std::uint16_t Draw(volume::BlockId id) const;

  int shard_count_;
  std::uint64_t seed_ = 0;
  std::vector<std::pair<volume::BlockId, std::uint16_t>> moved_;  // random: ascending by id
  std::vector<std::uint16_t> table_;                              // greedy: by id
};

// Both return the shard of each block, by BlockId, and leave no shard empty.
// REQUIRES: 1 <= shard_count <= min(block_count, store::kMaxShardCount).

// Independent Bernoulli trials: block `id` goes to a shard drawn from (seed, id) alone, so its
// shard does not depend on any other block. Where that leaves shards empty (likely only with few
// blocks a shard), the first blocks, by id, that are not alone in their shard move into the empty
// shards, in ascending order. O(block_count). Source: Zhang, Bajaj, Ramachandran 2002, section 2.1.
std::vector<std::uint16_t> DistributeRandomly(std::int64_t block_count, int shard_count,
                                              std::uint64_t seed);

// Deterministic: balances, for every isovalue, the number of active blocks (the workload
// histogram). Isovalues are cut into bins over the table's total span; blocks that cover the same
// bins are equal work and are dealt out together, those that cover most bins first: each shard gets
// the same number of them, and the shards whose histogram peaks lowest over those bins get what is
// left over (ties: fewest blocks, then lowest shard). Blocks that are never active even out the
// counts. O(block_count + bins^3 * shard_count), bins = 128 (32 above 1024 shards). Source: Zhang,
// Bajaj, Blanke 2001, "Scalable isosurface visualization of massive datasets on COTS clusters", and
// 2002, section 2.2.
std::vector<std::uint16_t> DistributeGreedily(const volume::RangeTable& ranges, int shard_count);

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_DISTRIBUTION_H_
