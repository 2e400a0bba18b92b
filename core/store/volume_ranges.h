// The range table of a volume, and the active sets computed from it. All open shards of the volume
// in a process share one copy.

#ifndef ISOSCOPE_CORE_STORE_VOLUME_RANGES_H_
#define ISOSCOPE_CORE_STORE_VOLUME_RANGES_H_

#include <cstddef>
#include <list>
#include <memory>
#include <utility>

#include "absl/base/thread_annotations.h"

#include "core/base/mutex.h"
#include "core/volume/block_set.h"
#include "core/volume/inside_rule.h"
#include "core/volume/range_table.h"

namespace isoscope::store {

// Thread-safe.
class VolumeRanges {
 public:
  // Returns the ranges with an equal table that this process holds already; else those of `table`.
  static std::shared_ptr<VolumeRanges> Share(volume::RangeTable table);

  explicit VolumeRanges(volume::RangeTable table) : table_(std::move(table)) {}
  VolumeRanges(const VolumeRanges&) = delete;
  VolumeRanges& operator=(const VolumeRanges&) = delete;

  [[nodiscard]] const volume::RangeTable& table() const { return table_; }
  // Returns table().ActiveBlocks(rule). Keeps the sets of the last rules, one bit for each block of
  // the volume: kMinSets of them, and up to kMaxSets that take at most kMaxBytes.
  // REQUIRES: isovalues are finite.
  [[nodiscard]] std::shared_ptr<const volume::BlockSet> ActiveBlocks(const volume::InsideRule& rule)
      ABSL_LOCKS_EXCLUDED(mutex_);

  static constexpr std::size_t kMinSets = 16;
  static constexpr std::size_t kMaxSets = 128;  // as many as a frame has surfaces
  static constexpr std::size_t kMaxBytes = std::size_t{4} << 20;

 private:
  struct Entry {
    volume::InsideRule rule;
    std::shared_ptr<const volume::BlockSet> active;
  };

  const volume::RangeTable table_;
  base::Mutex mutex_;
  std::list<Entry> entries_ ABSL_GUARDED_BY(mutex_);  // the last used first
};

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_VOLUME_RANGES_H_
