// Finds the blocks of an agent's shards that the surfaces of a frame meet (step 0 of a frame).

#ifndef ISOSCOPE_PARTITION_AGENT_SUPPLY_SURFACE_BLOCKS_H_
#define ISOSCOPE_PARTITION_AGENT_SUPPLY_SURFACE_BLOCKS_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/image/pixel_mask.h"
#include "core/view/clip_region.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_tree.h"
#include "core/volume/inside_rule.h"
#include "partition-agent/cache/block_cache.h"
#include "partition-agent/shard/shard.h"

namespace isoscope::agent {

// A mesh to draw: that of one surface in one block.
struct ChosenMesh {
  volume::BlockId block_id = 0;
  std::uint32_t ordinal = 0;        // of the block in its shard
  std::uint32_t active_index = 0;   // in the list of active blocks of its shard and surface
  std::uint32_t shard_index = 0;    // in SurfaceBlocks::shards()
  std::uint32_t surface_index = 0;  // in SurfaceBlocks::rules()
  // The open pixels of the block; null: all are open.
  const image::PixelMask* open = nullptr;
  // Whether its triangles and vertices count in the statistics.
  bool counts = true;
};

// The cost of finding active blocks: pages that were asked for, and bytes that were read.
struct IndexCost {
  std::int64_t page_read_count = 0;
  std::int64_t read_bytes = 0;
  // Lists of active blocks that the cache had, and lists that it lacked.
  std::int64_t kept_list_count = 0;
  std::int64_t queried_list_count = 0;
};

// Immutable; thread-safe. A block counts once, however many surfaces meet it. Memory: the lists, and
// a bit for each of their blocks; of volumes of up to volume::kMaxDenseBlocks blocks, some sets of
// half a megabyte on the way.
class SurfaceBlocks {
 public:
  // Asks the cache, which may be null, then for isovalues the interval trees, for labels the range
  // table. Adds to `cost`. Errors are those of IntervalTree::Query; also DATA_LOSS if a tree
  // contradicts the block index of its shard.
  // max_dense_blocks: lists of a volume with more blocks are sorted, without sets: the same lists
  //
  // REQUIRES: at least one shard, all of one dataset; at least one rule; isovalues are finite.
  static absl::StatusOr<SurfaceBlocks> Find(
      Shards shards, std::vector<volume::InsideRule> rules, BlockCache* cache,
      const base::Cancellation& cancellation, IndexCost* cost,
      std::int64_t max_dense_blocks = volume::kMaxDenseBlocks);

  [[nodiscard]] const Shards& shards() const { return shards_; }
  // By surface.
  [[nodiscard]] const std::vector<volume::InsideRule>& rules() const { return rules_; }
  // Returns the active blocks of a shard and surface, in ascending order of block ids.
  [[nodiscard]] const std::vector<ActiveBlock>& ActiveOf(std::size_t shard_index,
                                                         std::size_t surface_index) const {
    return *active_[shard_index * rules_.size() + surface_index];
  }

  // Removes the blocks that are wholly clipped: the functions below no longer return them.
  void EraseOutside(const view::Clipper& clipper);

  // The number of blocks that any surface meets, and these blocks, ascending.
  [[nodiscard]] std::int64_t block_count() const;
  [[nodiscard]] std::vector<volume::BlockId> Ids() const;

  // Returns all meshes, in order of shard, surface, block.
  [[nodiscard]] std::vector<ChosenMesh> ChooseAll() const;
  // Returns the meshes in the blocks `ids`, ascending. INVALID_ARGUMENT if one is not active, or
  // wholly clipped.
  [[nodiscard]] absl::StatusOr<std::vector<ChosenMesh>> Choose(
      const std::vector<volume::BlockId>& ids) const;

 private:
  SurfaceBlocks() = default;

  // list, i: in active_, and in that list
  [[nodiscard]] bool IsShown(std::size_t list, std::size_t i) const {
    return is_shown_.empty() || is_shown_[list][i];
  }

  Shards shards_;
  bool is_large_ = false;  // more than max_dense_blocks
  std::vector<volume::InsideRule> rules_;
  std::vector<std::shared_ptr<const std::vector<ActiveBlock>>> active_;  // by shard, surface
  // Of each list of active_, for each of its blocks; empty: all are shown.
  std::vector<std::vector<bool>> is_shown_;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_SUPPLY_SURFACE_BLOCKS_H_
