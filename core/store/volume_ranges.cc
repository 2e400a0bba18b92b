#include "core/store/volume_ranges.h"

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

namespace isoscope::store {
namespace {

// The ranges that shards of this process share. The ranges of a volume are freed with its last
// shard.
class Pool {
 public:
  std::shared_ptr<VolumeRanges> Share(volume::RangeTable table) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    std::erase_if(shared_, [](const auto& ranges) { return ranges.expired(); });
    for (const std::weak_ptr<VolumeRanges>& weak : shared_) {
      std::shared_ptr<VolumeRanges> ranges = weak.lock();
      if (ranges != nullptr && ranges->table() == table) {
        return ranges;
      }
    }
    auto ranges = std::make_shared<VolumeRanges>(std::move(table));
    shared_.push_back(ranges);
    return ranges;
  }

 private:
  base::Mutex mutex_;
  std::vector<std::weak_ptr<VolumeRanges>> shared_ ABSL_GUARDED_BY(mutex_);  // a few
};

}  // namespace

std::shared_ptr<VolumeRanges> VolumeRanges::Share(volume::RangeTable table) {
  static Pool& pool = *new Pool;  // shards may be closed while the process ends
  return pool.Share(std::move(table));
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

}  // namespace isoscope::store
