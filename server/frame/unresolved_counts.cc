#include "server/frame/unresolved_counts.h"

#include "server/frame/active_blocks.h"

namespace isoscope::server {

std::string UnresolvedCounts::KeyOf(const std::string& dataset_id, const volume::InsideRule& rule,
                                    int level) {
  return ActiveBlocksCache::KeyOf(dataset_id, level, /*shard_indices_by_agent=*/{}, {rule});
}

std::optional<std::int64_t> UnresolvedCounts::Find(const std::string& key) {
  // Without rounds the cache would keep its first values for ever.
  counts_.SetRound(next_round_.fetch_add(1, std::memory_order_relaxed));
  const std::shared_ptr<const std::int64_t> found = counts_.Find(key);
  (found == nullptr ? misses_ : hits_).Add();
  return found == nullptr ? std::nullopt : std::optional<std::int64_t>(*found);
}

void UnresolvedCounts::Insert(const std::string& key, std::int64_t count) {
  // The key is kept twice, in the list and in the map.
  counts_.Insert(key, std::make_shared<const std::int64_t>(count),
                 sizeof(std::int64_t) + 2 * key.size());
}

void UnresolvedCounts::AppendSamples(base::MetricFamily* lookups) const {
  using base::MetricSample;
  lookups->samples.push_back(
      MetricSample::Of(hits_, {{"cache", "unresolved_counts"}, {"result", "hit"}}));
  lookups->samples.push_back(
      MetricSample::Of(misses_, {{"cache", "unresolved_counts"}, {"result", "miss"}}));
}

}  // namespace isoscope::server
