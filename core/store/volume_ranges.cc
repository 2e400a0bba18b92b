#include "core/store/volume_ranges.h"

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "core/base/check.h"
#include "core/base/log.h"
#include "core/base/status_macros.h"
#include "core/volume/scalar_type.h"

namespace isoscope::store {
namespace {

// The ranges that shards of this process share. The ranges of a volume are freed with its last
// shard.
class Pool {
 public:
  // Returns those for which is_same is true, else what make() returns.
  template <typename IsSame, typename Make>
  std::shared_ptr<VolumeRanges> Share(const IsSame& is_same, const Make& make)
      ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    std::erase_if(shared_, [](const auto& ranges) { return ranges.expired(); });
    for (const std::weak_ptr<VolumeRanges>& weak : shared_) {
      std::shared_ptr<VolumeRanges> ranges = weak.lock();
      if (ranges != nullptr && is_same(*ranges)) {
        return ranges;
      }
    }
    std::shared_ptr<VolumeRanges> ranges = make();
    shared_.push_back(ranges);
    return ranges;
  }

  // Calls fn with each that is in use.
  template <typename Fn>
  void ForEach(const Fn& fn) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    for (const std::weak_ptr<VolumeRanges>& weak : shared_) {
      if (const std::shared_ptr<VolumeRanges> ranges = weak.lock(); ranges != nullptr) {
        fn(*ranges);
      }
    }
  }

 private:
  base::Mutex mutex_;
  std::vector<std::weak_ptr<VolumeRanges>> shared_ ABSL_GUARDED_BY(mutex_);  // a few
};

Pool& SharedPool() {
  static Pool& pool = *new Pool;  // shards may be closed while the process ends
  return pool;
}

// A table whose spans hold every value of the type.
volume::RangeTable WidestTable(volume::ScalarType type, std::int64_t block_count) {
  volume::RangeTable table(type, block_count);
  for (std::int64_t id = 0; id < block_count; ++id) {
    table.Set(static_cast<volume::BlockId>(id), volume::WidestSpan(type));
  }
  return table;
}

}  // namespace

std::shared_ptr<VolumeRanges> VolumeRanges::Share(const math::Index3& block_dims,
                                                  volume::RangeTable table) {
  return SharedPool().Share(
      [&](const VolumeRanges& other) {
        return !other.is_in_file() && other.block_dims() == block_dims && other.table() == table;
      },
      [&] { return std::make_shared<VolumeRanges>(block_dims, std::move(table)); });
}

std::shared_ptr<VolumeRanges> VolumeRanges::Share(const std::string& key, volume::SpanOctree octree,
                                                  LoadTable load_table) {
  return SharedPool().Share([&](const VolumeRanges& other) { return other.key() == key; },
                            [&] {
                              return std::make_shared<VolumeRanges>(key, std::move(octree),
                                                                    std::move(load_table));
                            });
}

std::size_t VolumeRanges::LaterBytes() {
  std::size_t bytes = 0;
  SharedPool().ForEach([&](const VolumeRanges& ranges) { bytes += ranges.later_bytes(); });
  return bytes;
}

std::size_t VolumeRanges::later_bytes() const {
  if (math::Volume(block_dims_) <= volume::kMaxDenseBlocks) {
    return 0;
  }
  // At most 16 bytes for each brick of 64 blocks (volume::BlockTree).
  const std::size_t largest_tree = static_cast<std::size_t>(math::Volume(block_dims_)) / 4;
  return std::max(kMaxTreeBytes, largest_tree) + (is_in_file() ? file_octree_->size_bytes() : 0);
}

VolumeRanges::VolumeRanges(std::string key, volume::SpanOctree octree, LoadTable load_table)
    : block_dims_(octree.layout().block_dims),
      key_(std::move(key)),
      load_table_(std::move(load_table)),
      file_octree_(std::move(octree)) {
  ISOSCOPE_CHECK(!key_.empty() && load_table_ != nullptr);
}

const volume::RangeTable& VolumeRanges::table() const {
  if (!is_in_file() || has_table_.load(std::memory_order_acquire)) {
    return table_;
  }
  const base::MutexLock lock(&table_mutex_);
  if (has_table_.load(std::memory_order_relaxed)) {
    return table_;
  }
  absl::StatusOr<volume::RangeTable> table = load_table_();
  if (!table.ok()) {
    base::LogError("range_table_unreadable", {{"error", table.status()}});
    table = WidestTable(file_octree_->page_spans().type(), math::Volume(block_dims_));
  }
  table_ = *std::move(table);
  has_table_.store(true, std::memory_order_release);
  return table_;
}

absl::StatusOr<volume::ScalarSpan> VolumeRanges::SpanOf(volume::BlockId id) const {
  if (!is_in_file()) {
    return table_.Get(id);
  }
  return file_octree_->SpanOf(id);
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
  auto active = std::make_shared<const volume::BlockSet>(table().ActiveBlocks(rule));
  entries_.push_front({rule, active});
  const std::size_t set_bytes = active->words().size() * sizeof(std::uint64_t);
  const std::size_t max_sets =
      std::clamp(kMaxBytes / std::max<std::size_t>(set_bytes, 1), kMinSets, kMaxSets);
  if (entries_.size() > max_sets) {
    entries_.pop_back();
  }
  return active;
}

const volume::SpanOctree& VolumeRanges::Octree() {
  if (is_in_file()) {
    return *file_octree_;
  }
  if (!table_octree_.has_value()) {
    table_octree_ = volume::SpanOctree::OfTable(block_dims_, table_);
  }
  return *table_octree_;
}

absl::StatusOr<std::shared_ptr<const volume::BlockTree>> VolumeRanges::ActiveTree(
    const volume::InsideRule& rule) {
  // The lock is held while a tree is made, because agents of one process need the same one at once.
  const base::MutexLock lock(&mutex_);
  const auto found = std::find_if(trees_.begin(), trees_.end(),
                                  [&](const TreeEntry& entry) { return entry.rule == rule; });
  if (found != trees_.end()) {
    trees_.splice(trees_.begin(), trees_, found);
    return found->active;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(volume::BlockTree tree, Octree().ActiveBlocks(rule));
  auto active = std::make_shared<const volume::BlockTree>(std::move(tree));
  trees_.push_front({rule, active});
  std::size_t bytes = 0;
  std::size_t count = 0;
  for (auto entry = trees_.begin(); entry != trees_.end(); ++entry) {
    bytes += entry->active->size_bytes();
    ++count;
    if ((bytes > kMaxTreeBytes || count > kMaxSets) && entry != trees_.begin()) {
      trees_.erase(entry, trees_.end());
      break;
    }
  }
  return active;
}

}  // namespace isoscope::store
