#include "core/partition/block_cutter.h"

#include <cstddef>
#include <cstring>

#include "core/math/box.h"
#include "core/volume/min_max.h"

namespace isoscope::partition {
namespace {

// Calls visit(row, sample count) for each row of `box`.
template <typename Visit>
void ForEachRow(const volume::BlockLayout& layout, std::size_t sample_size, const Slab& slab,
                const math::IndexBox& box, const Visit& visit) {
  const math::Index3& dims = layout.sample_dims();
  const std::int64_t rows = slab.rows == 0 ? dims.y : slab.rows;
  const auto count = static_cast<std::size_t>(box.end.x - box.begin.x);
  for (std::int64_t z = box.begin.z; z < box.end.z; ++z) {
    for (std::int64_t y = box.begin.y; y < box.end.y; ++y) {
      const std::int64_t first =
          ((z - slab.begin_z) * rows + y - slab.begin_y) * dims.x + box.begin.x;
      visit(slab.samples + static_cast<std::size_t>(first) * sample_size, count);
    }
  }
}

}  // namespace

volume::ScalarSpan SpanOfBlock(const volume::BlockLayout& layout, volume::ScalarType type,
                               const Slab& slab, volume::BlockId id) {
  return volume::VisitScalarType(type, [&]<typename T>() {
    volume::MinMax<T> min_max;
    ForEachRow(layout, sizeof(T), slab, layout.OwnSamplesOf(id),
               [&](const char* row, std::size_t count) { min_max.AddRow(row, count); });
    return min_max.Get();
  });
}

void CutBlock(const volume::BlockLayout& layout, volume::ScalarType type, const Slab& slab,
              volume::BlockId id, char* out) {
  const std::size_t sample_size = volume::SizeOf(type);
  ForEachRow(layout, sample_size, slab, layout.StoredSamplesOf(id),
             [&](const char* row, std::size_t count) {
               std::memcpy(out, row, count * sample_size);
               out += count * sample_size;
             });
}

}  // namespace isoscope::partition
