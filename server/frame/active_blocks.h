// The active blocks of surfaces and the agents that own them. Agents report them in step 1. The
// coordinator keeps them, so that the next frame with the same surfaces need not ask.

#ifndef ISOSCOPE_SERVER_FRAME_ACTIVE_BLOCKS_H_
#define ISOSCOPE_SERVER_FRAME_ACTIVE_BLOCKS_H_

#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"

#include "core/base/metrics.h"
#include "core/base/mutex.h"
#include "core/math/vec.h"
#include "core/visibility/open_blocks.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_set.h"
#include "core/volume/block_tree.h"
#include "core/volume/inside_rule.h"

namespace isoscope::server {

// The active blocks of a large volume as a tree, whose hidden parts are skipped as wholes.
struct ActiveTree {
  ActiveTree(const math::Index3& block_dims, const std::vector<volume::BlockId>& ids);

  // Returns whether the block ids[active_index] is set in marks, which have the shape of
  // blocks.words().
  [[nodiscard]] bool IsMarked(const std::vector<std::uint64_t>& marks,
                              std::size_t active_index) const {
    return (marks[places[active_index] >> 6] >> (places[active_index] & 63) & 1) != 0;
  }
  // Returns the marks of those of the blocks that are active.
  [[nodiscard]] std::vector<std::uint64_t> MarksOf(const std::vector<volume::BlockId>& ids) const;
  [[nodiscard]] std::size_t size_bytes() const;

  const volume::BlockTree blocks;
  const visibility::BlockCubes cubes;  // of `blocks`
  std::vector<std::uint64_t> places;   // of each of the ids: index of its word * 64 + bit
};

// The active blocks of the volume, agent by agent, each agent's ascending. Immutable once shared.
struct ActiveBlocks {
  // Makes a tree if the volume has more than `max_dense_blocks` blocks, else a set.
  // REQUIRES: every block is one of the layout's.
  ActiveBlocks(const std::vector<std::vector<volume::BlockId>>& by_agent,
               const volume::BlockLayout& layout,
               std::int64_t max_dense_blocks = volume::kMaxDenseBlocks);

  std::vector<volume::BlockId> ids;
  std::vector<std::size_t> begin_by_agent;  // in ids; one more than agents
  volume::BlockSet set;                     // of no blocks if there is a tree
  std::unique_ptr<const ActiveTree> tree;   // null: there is a set
};

// Keeps the active blocks of the keys used last, bounded in bytes. Thread-safe.
class ActiveBlocksCache {
 public:
  explicit ActiveBlocksCache(std::size_t max_bytes) : max_bytes_(max_bytes) {}

  // Returns the key of a frame. The active blocks and their owners follow from the dataset's
  // content, the level, the shards of each agent, and the rules of the frame's surfaces.
  static std::string KeyOf(const std::string& dataset_id, int level,
                           const std::vector<std::vector<int>>& shard_indices_by_agent,
                           const std::vector<volume::InsideRule>& rules);

  // Counts the look. Returns null if there is no value.
  std::shared_ptr<const ActiveBlocks> Find(const std::string& key);
  void Insert(const std::string& key, std::shared_ptr<const ActiveBlocks> active);

  void AppendMetrics(std::vector<base::MetricFamily>* families) const;

 private:
  struct Entry {
    std::string key;
    std::shared_ptr<const ActiveBlocks> active;
    std::size_t size_bytes = 0;
  };

  const std::size_t max_bytes_;
  base::Counter hits_;
  base::Counter misses_;
  base::Mutex mutex_;
  std::list<Entry> entries_ ABSL_GUARDED_BY(mutex_);  // most recently used first; few
  std::size_t size_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_ACTIVE_BLOCKS_H_
