// The range table of a volume, and the active sets computed from it. All open shards of the volume
// in a process share one copy.

#ifndef ISOSCOPE_CORE_STORE_VOLUME_RANGES_H_
#define ISOSCOPE_CORE_STORE_VOLUME_RANGES_H_

#include <cstddef>
#include <list>
#include <memory>
#include <optional>
#include <utility>

#include "absl/base/thread_annotations.h"

#include "core/base/mutex.h"
#include "core/math/vec.h"
#include "core/volume/block_set.h"
#include "core/volume/block_tree.h"
#include "core/volume/inside_rule.h"
#include "core/volume/range_table.h"
#include "core/volume/span_octree.h"

namespace isoscope::store {

// Thread-safe.
class VolumeRanges {
 public:
  // Returns the ranges with an equal table that this process holds already; else those of `table`.
  // REQUIRES: the table has Volume(block_dims) blocks.
  static std::shared_ptr<VolumeRanges> Share(const math::Index3& block_dims,
                                             volume::RangeTable table);

  VolumeRanges(const math::Index3& block_dims, volume::RangeTable table)
      : table_(std::move(table)), block_dims_(block_dims) {}
  VolumeRanges(const VolumeRanges&) = delete;
  VolumeRanges& operator=(const VolumeRanges&) = delete;

  [[nodiscard]] const math::Index3& block_dims() const { return block_dims_; }
  [[nodiscard]] const volume::RangeTable& table() const { return table_; }
  // Returns table().ActiveBlocks(rule). Keeps the sets of the last rules, one bit for each block of
  // the volume: kMinSets of them, and up to kMaxSets that take at most kMaxBytes.
  // REQUIRES: isovalues are finite.
  [[nodiscard]] std::shared_ptr<const volume::BlockSet> ActiveBlocks(const volume::InsideRule& rule)
      ABSL_LOCKS_EXCLUDED(mutex_);

  // Returns the same as a tree, found by an octree of spans that is built at the first call. Keeps
  // the trees of the last rules: one, and more that take at most kMaxTreeBytes together.
  [[nodiscard]] std::shared_ptr<const volume::BlockTree> ActiveTree(const volume::InsideRule& rule)
      ABSL_LOCKS_EXCLUDED(mutex_);

  static constexpr std::size_t kMaxTreeBytes = std::size_t{64} << 20;
  static constexpr std::size_t kMinSets = 16;
  static constexpr std::size_t kMaxSets = 128;  // as many as a frame has surfaces
  static constexpr std::size_t kMaxBytes = std::size_t{4} << 20;

 private:
  struct Entry {
    volume::InsideRule rule;
    std::shared_ptr<const volume::BlockSet> active;
  };

  struct TreeEntry {
    volume::InsideRule rule;
    std::shared_ptr<const volume::BlockTree> active;
  };

  const volume::RangeTable table_;
  const math::Index3 block_dims_;
  base::Mutex mutex_;
  std::list<Entry> entries_ ABSL_GUARDED_BY(mutex_);    // the last used first
  std::list<TreeEntry> trees_ ABSL_GUARDED_BY(mutex_);  // the last used first
  std::optional<volume::SpanOctree> octree_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_VOLUME_RANGES_H_
