// The boxes of the active cells of surfaces, which cameras fit. The coordinator keeps them, so that
// the next frame with the same surfaces and region need not ask.

#ifndef ISOSCOPE_SERVER_FRAME_CELL_BOXES_H_
#define ISOSCOPE_SERVER_FRAME_CELL_BOXES_H_

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/base/lru_cache.h"
#include "core/base/metrics.h"
#include "core/math/box.h"
#include "core/view/clip_region.h"
#include "core/volume/inside_rule.h"

namespace isoscope::server {

// Keeps the boxes of the keys used last, bounded in bytes. Thread-safe.
class CellBoxCache {
 public:
  static constexpr std::size_t kMaxBytes = std::size_t{256} << 10;

  // Not set: there are no active cells.
  using CellBox = std::optional<math::IndexBox>;

  // Returns the key of a frame: the box follows from the dataset's content, the surfaces and the
  // region.
  static std::string KeyOf(const std::string& dataset_id,
                           const std::vector<volume::InsideRule>& rules,
                           const view::ClipRegion& clip);

  // Counts the look. Returns null if there is no value.
  std::shared_ptr<const CellBox> Find(const std::string& key);
  void Insert(const std::string& key, const CellBox& box);

  // Adds its samples to the family of the looks into caches (ActiveBlocksCache::AppendMetrics).
  void AppendSamples(base::MetricFamily* lookups) const;

 private:
  base::Counter hits_;
  base::Counter misses_;
  std::atomic<std::uint64_t> next_round_{2};  // one for each look
  base::LruCache<std::string, CellBox, 1> boxes_{kMaxBytes};
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_CELL_BOXES_H_
