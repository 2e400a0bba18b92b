#include "core/volume/block_spans.h"

#include <cstddef>
#include <limits>
#include <type_traits>
#include <utility>

#include "absl/status/statusor.h"

#include "core/base/check.h"
#include "core/volume/active_spans.h"

namespace isoscope::volume {

ScalarSpan WidestSpan(ScalarType type) {
  return VisitScalarType(type, []<typename T>() -> ScalarSpan {
    if constexpr (std::is_floating_point_v<T>) {
      constexpr double kInfinity = std::numeric_limits<double>::infinity();
      return {-kInfinity, kInfinity};
    } else {
      return {static_cast<double>(std::numeric_limits<T>::lowest()),
              static_cast<double>(std::numeric_limits<T>::max())};
    }
  });
}

BlockSpans::BlockSpans(const RangeTable& table) : table_(&table), type_(table.type()) {}

BlockSpans::BlockSpans(const SpanOctree& octree)
    : octree_(&octree), type_(octree.page_spans().type()) {}

ScalarSpan BlockSpans::FromPage(BlockId id) {
  const math::Index3& dims = octree_->layout().block_dims;
  ISOSCOPE_CHECK_LT(std::int64_t{id}, math::Volume(dims));
  const std::int64_t row = id / dims.x;
  const math::Index3 index{id % dims.x, row % dims.y, row / dims.y};
  const SpanPageLayout::Place place = octree_->layout().PlaceOf(index);
  // Pages next to each other differ in the parity of an axis, so they never push each other out.
  constexpr std::int64_t kSide = SpanPageLayout::kPageSide;
  const auto slot = static_cast<std::size_t>((index.x / kSide & 1) | (index.y / kSide & 1) << 1 |
                                             (index.z / kSide & 1) << 2);
  KeptPage& kept = kept_[slot];
  if (kept.page != place.page) {
    absl::StatusOr<std::shared_ptr<const std::string>> bytes = octree_->LoadPage(place.page);
    status_.Update(bytes.status());
    kept = {place.page, bytes.ok() ? *std::move(bytes) : nullptr};
  }
  return kept.bytes == nullptr ? WidestSpan(type_) : SpanAt(type_, *kept.bytes, place.span);
}

}  // namespace isoscope::volume
