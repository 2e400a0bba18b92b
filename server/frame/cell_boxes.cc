#include "server/frame/cell_boxes.h"

#include <bit>
#include <memory>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

#include "server/frame/active_blocks.h"

namespace isoscope::server {

std::string CellBoxCache::KeyOf(const std::string& dataset_id,
                                const std::vector<volume::InsideRule>& rules,
                                const view::ClipRegion& clip) {
  std::string key =
      ActiveBlocksCache::KeyOf(dataset_id, /*level=*/0, /*shard_indices_by_agent=*/{}, rules);
  const auto append = [&key](absl::string_view mark, double value) {
    absl::StrAppend(&key, mark, absl::Hex(std::bit_cast<std::uint64_t>(value + 0.0)));
  };
  const auto append_vector = [&](absl::string_view mark, const math::Vec3d& vector) {
    append(mark, vector.x);
    append(",", vector.y);
    append(",", vector.z);
  };
  for (const view::HalfSpace& half_space : clip.half_spaces) {
    append_vector("/", half_space.normal);
    append(",", half_space.offset);
  }
  if (clip.box.has_value()) {
    append_vector("[", clip.box->min);
    append_vector("]", clip.box->max);
  }
  return key;
}

std::shared_ptr<const CellBoxCache::CellBox> CellBoxCache::Find(const std::string& key) {
  // Without rounds the cache would keep its first values for ever.
  boxes_.SetRound(next_round_.fetch_add(1, std::memory_order_relaxed));
  std::shared_ptr<const CellBox> found = boxes_.Find(key);
  (found == nullptr ? misses_ : hits_).Add();
  return found;
}

void CellBoxCache::Insert(const std::string& key, const CellBox& box) {
  // The key is kept twice, in the list and in the map.
  boxes_.Insert(key, std::make_shared<const CellBox>(box), sizeof(CellBox) + 2 * key.size());
}

void CellBoxCache::AppendSamples(base::MetricFamily* lookups) const {
  using base::MetricSample;
  lookups->samples.push_back(MetricSample::Of(hits_, {{"cache", "cell_boxes"}, {"result", "hit"}}));
  lookups->samples.push_back(
      MetricSample::Of(misses_, {{"cache", "cell_boxes"}, {"result", "miss"}}));
}

}  // namespace isoscope::server
