#include "server/frame/active_counts.h"

#include <memory>

#include "absl/strings/str_cat.h"

#include "server/frame/cell_boxes.h"

namespace isoscope::server {

std::string ActiveCounts::KeyOf(const std::string& dataset_id, int level,
                                const std::vector<volume::InsideRule>& rules,
                                const view::ClipRegion& clip) {
  return absl::StrCat(level, ":", CellBoxCache::KeyOf(dataset_id, rules, clip));
}

std::optional<std::int64_t> ActiveCounts::Find(const std::string& key) {
  // Without rounds the cache would keep its first values for ever.
  counts_.SetRound(next_round_.fetch_add(1, std::memory_order_relaxed));
  const std::shared_ptr<const std::int64_t> found = counts_.Find(key);
  (found == nullptr ? misses_ : hits_).Add();
  return found == nullptr ? std::nullopt : std::optional<std::int64_t>(*found);
}

void ActiveCounts::Insert(const std::string& key, std::int64_t count) {
  // The key is kept twice, in the list and in the map.
  counts_.Insert(key, std::make_shared<const std::int64_t>(count),
                 sizeof(std::int64_t) + 2 * key.size());
}

void ActiveCounts::AppendSamples(base::MetricFamily* lookups) const {
  using base::MetricSample;
  lookups->samples.push_back(
      MetricSample::Of(hits_, {{"cache", "active_counts"}, {"result", "hit"}}));
  lookups->samples.push_back(
      MetricSample::Of(misses_, {{"cache", "active_counts"}, {"result", "miss"}}));
}

}  // namespace isoscope::server
