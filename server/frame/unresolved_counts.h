// The numbers of blocks that a level shows nothing of (core/volume/resolved_blocks.h). Agents read
// the level's active blocks for one, so the coordinator keeps them.

#ifndef ISOSCOPE_SERVER_FRAME_UNRESOLVED_COUNTS_H_
#define ISOSCOPE_SERVER_FRAME_UNRESOLVED_COUNTS_H_

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "core/base/lru_cache.h"
#include "core/base/metrics.h"
#include "core/volume/inside_rule.h"

namespace isoscope::server {

// Keeps the numbers of the keys used last, bounded in bytes. Thread-safe.
class UnresolvedCounts {
 public:
  static constexpr std::size_t kMaxBytes = std::size_t{128} << 10;

  // Returns the key of a surface at a level. Smooth labels have the cells of others.
  //
  // dataset_id: of the scalar volume: a field at a time step
  static std::string KeyOf(const std::string& dataset_id, const volume::InsideRule& rule,
                           int level);

  // Counts the look.
  std::optional<std::int64_t> Find(const std::string& key);
  void Insert(const std::string& key, std::int64_t count);

  // Adds its samples to the family of the looks into caches (ActiveBlocksCache::AppendMetrics).
  void AppendSamples(base::MetricFamily* lookups) const;

 private:
  base::Counter hits_;
  base::Counter misses_;
  std::atomic<std::uint64_t> next_round_{2};  // one for each look
  base::LruCache<std::string, std::int64_t, 1> counts_{kMaxBytes};
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_UNRESOLVED_COUNTS_H_
