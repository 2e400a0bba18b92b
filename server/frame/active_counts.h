// The numbers of active blocks of surfaces in a clip region, at a level. Agents know them without the
// samples, but must be asked.

#ifndef ISOSCOPE_SERVER_FRAME_ACTIVE_COUNTS_H_
#define ISOSCOPE_SERVER_FRAME_ACTIVE_COUNTS_H_

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/base/lru_cache.h"
#include "core/base/metrics.h"
#include "core/view/clip_region.h"
#include "core/volume/inside_rule.h"

namespace isoscope::server {

// Keeps the numbers of the keys used last, bounded in bytes. Thread-safe.
class ActiveCounts {
 public:
  static constexpr std::size_t kMaxBytes = std::size_t{128} << 10;

  // dataset_id: of the scalar volume: a field at a time step
  static std::string KeyOf(const std::string& dataset_id, int level,
                           const std::vector<volume::InsideRule>& rules,
                           const view::ClipRegion& clip);

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

#endif  // ISOSCOPE_SERVER_FRAME_ACTIVE_COUNTS_H_
