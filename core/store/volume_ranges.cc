#include "core/store/volume_ranges.h"

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"

#include "core/base/check.h"

namespace isoscope::store {
namespace {

// The ranges that shards of this process share. The ranges of a volume are freed with its last
// shard.
class Pool {
 public:
  std::shared_ptr<VolumeRanges> Share(const math::Index3& block_dims, volume::RangeTable table)
      ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    std::erase_if(shared_, [](const auto& ranges) { return ranges.expired(); });
    for (const std::weak_ptr<VolumeRanges>& weak : shared_) {
      std::shared_ptr<VolumeRanges> ranges = weak.lock();
      if (ranges != nullptr && ranges->block_dims() == block_dims && ranges->table() == table) {
        return ranges;
      }
    }
    auto ranges = std::make_shared<VolumeRanges>(block_dims, std::move(table));
    shared_.push_back(ranges);
    return ranges;
  }

 private:
  base::Mutex mutex_;
  std::vector<std::weak_ptr<VolumeRanges>> shared_ ABSL_GUARDED_BY(mutex_);  // a few
};

}  // namespace

std::shared_ptr<VolumeRanges> VolumeRanges::Share(const math::Index3& block_dims,
                                                  volume::RangeTable table) {
  static Pool& pool = *new Pool;  // shards may be closed while the process ends
  return pool.Share(block_dims, std::move(table));
}

std::shared_ptr<const volume::BlockSet> VolumeRanges::ActiveBlocks(const volume::InsideRule& rule) {
  // The lock is held while a set is made, because agents of one process need the same set at once.
  const base::MutexLock lock(&mutex_);
  const auto found = std::find_if(entries_.begin(), entries_.end(),
                                  [&](const Entry& entry) { return entry.rule == rule; });
  if (found != entries_.end()) {
    entries_.splice(entries_.begin(), entries_, found);
    return found->active;
  }
  auto active = std::make_shared<const volume::BlockSet>(table_.ActiveBlocks(rule));
  entries_.push_front({rule, active});
  const std::size_t set_bytes = active->words().size() * sizeof(std::uint64_t);
  const std::size_t max_sets =
      std::clamp(kMaxBytes / std::max<std::size_t>(set_bytes, 1), kMinSets, kMaxSets);
  if (entries_.size() > max_sets) {
    entries_.pop_back();
  }
  return active;
}

std::shared_ptr<const volume::BlockTree> VolumeRanges::ActiveTree(const volume::InsideRule& rule) {
  // The lock is held while a tree is made, because agents of one process need the same one at once.
  const base::MutexLock lock(&mutex_);
  const auto found = std::find_if(trees_.begin(), trees_.end(),
                                  [&](const TreeEntry& entry) { return entry.rule == rule; });
  if (found != trees_.end()) {
    trees_.splice(trees_.begin(), trees_, found);
    return found->active;
  }
  if (!octree_.has_value()) {
    octree_ = volume::SpanOctree::OfTable(block_dims_, table_);
  }
  absl::StatusOr<volume::BlockTree> tree = octree_->ActiveBlocks(rule);
  ISOSCOPE_CHECK(tree.ok());  // the table is in memory
  auto active = std::make_shared<const volume::BlockTree>(*std::move(tree));
  trees_.push_front({rule, active});
  std::size_t bytes = 0;
  for (auto entry = trees_.begin(); entry != trees_.end(); ++entry) {
    bytes += entry->active->size_bytes();
    if (bytes > kMaxTreeBytes && entry != trees_.begin()) {
      trees_.erase(entry, trees_.end());
      break;
    }
  }
  return active;
}

}  // namespace isoscope::store
