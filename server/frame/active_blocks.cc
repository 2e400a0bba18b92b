#include "server/frame/active_blocks.h"

#include <algorithm>
#include <bit>
#include <cstdint>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/string_view.h"

namespace isoscope::server {
namespace {

std::size_t SizeBytes(const std::string& key, const ActiveBlocks& active) {
  return key.size() + sizeof(active) + active.ids.capacity() * sizeof(volume::BlockId) +
         active.begin_by_agent.capacity() * sizeof(std::size_t) +
         active.set.words().size() * sizeof(std::uint64_t) +
         (active.tree != nullptr ? active.tree->size_bytes() : 0);
}

}  // namespace

ActiveTree::ActiveTree(const math::Index3& block_dims, const std::vector<volume::BlockId>& ids)
    : blocks(block_dims, volume::BlockSet(math::Volume(block_dims), ids)), cubes(blocks) {
  places.reserve(ids.size());
  for (const volume::BlockId id : ids) {
    const auto code = static_cast<std::uint64_t>(blocks.CodeOf(id));
    places.push_back(std::uint64_t{blocks.cells()[code >> 6]} << 6 | (code & 63));
  }
}

std::vector<std::uint64_t> ActiveTree::MarksOf(const std::vector<volume::BlockId>& ids) const {
  std::vector<std::uint64_t> marks(blocks.words().size());
  for (const volume::BlockId id : ids) {
    const auto code = static_cast<std::uint64_t>(blocks.CodeOf(id));
    const std::uint32_t cell = blocks.cells()[code >> 6];
    if (cell < volume::BlockTree::kEmpty) {
      marks[cell] |= std::uint64_t{1} << (code & 63) & blocks.words()[cell];
    }
  }
  return marks;
}

std::size_t ActiveTree::size_bytes() const {
  return blocks.size_bytes() + cubes.size_bytes() + places.capacity() * sizeof(places[0]);
}

ActiveBlocks::ActiveBlocks(const std::vector<std::vector<volume::BlockId>>& by_agent,
                           const volume::BlockLayout& layout, std::int64_t max_dense_blocks)
    : begin_by_agent{0} {
  for (const std::vector<volume::BlockId>& of_agent : by_agent) {
    ids.insert(ids.end(), of_agent.begin(), of_agent.end());
    begin_by_agent.push_back(ids.size());
  }
  if (layout.block_count() > max_dense_blocks) {
    tree = std::make_unique<const ActiveTree>(layout.block_dims(), ids);
  } else {
    set = volume::BlockSet(layout.block_count(), ids);
  }
}

std::string ActiveBlocksCache::KeyOf(const std::string& dataset_id, int level,
                                     const std::vector<std::vector<int>>& shard_indices_by_agent,
                                     const std::vector<volume::InsideRule>& rules) {
  std::string key = absl::StrCat(dataset_id, "^", level);
  const auto append = [&key](absl::string_view mark, double value) {
    absl::StrAppend(&key, mark, absl::Hex(std::bit_cast<std::uint64_t>(value + 0.0)));
  };
  for (const volume::InsideRule& rule : rules) {
    append("@", rule.isovalue);
    for (const double label : rule.labels) {
      append("|", label);
    }
  }
  for (const std::vector<int>& indices : shard_indices_by_agent) {
    absl::StrAppend(&key, "/", absl::StrJoin(indices, ","));
  }
  return key;
}

std::shared_ptr<const ActiveBlocks> ActiveBlocksCache::Find(const std::string& key) {
  base::MutexLock lock(&mutex_);
  const auto found = std::find_if(entries_.begin(), entries_.end(),
                                  [&](const Entry& entry) { return entry.key == key; });
  if (found == entries_.end()) {
    misses_.Add();
    return nullptr;
  }
  hits_.Add();
  entries_.splice(entries_.begin(), entries_, found);
  return found->active;
}

void ActiveBlocksCache::AppendMetrics(std::vector<base::MetricFamily>* families) const {
  using base::MetricSample;
  families->push_back(
      {.name = "isoscope_cache_lookups_total",
       .help = "Looks into a cache, by result.",
       .type = base::MetricFamily::Type::kCounter,
       .samples = {MetricSample::Of(hits_, {{"cache", "active_blocks"}, {"result", "hit"}}),
                   MetricSample::Of(misses_, {{"cache", "active_blocks"}, {"result", "miss"}})}});
}

void ActiveBlocksCache::Insert(const std::string& key, std::shared_ptr<const ActiveBlocks> active) {
  const std::size_t size = SizeBytes(key, *active);
  if (size > max_bytes_) {
    return;
  }
  base::MutexLock lock(&mutex_);
  const auto found = std::find_if(entries_.begin(), entries_.end(),
                                  [&](const Entry& entry) { return entry.key == key; });
  if (found != entries_.end()) {
    return;  // another frame has inserted the same value
  }
  while (size_bytes_ + size > max_bytes_) {
    size_bytes_ -= entries_.back().size_bytes;
    entries_.pop_back();
  }
  size_bytes_ += size;
  entries_.push_front({key, std::move(active), size});
}

}  // namespace isoscope::server
