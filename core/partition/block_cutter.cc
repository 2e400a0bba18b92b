#include "core/partition/block_cutter.h"

#include <cstddef>
#include <cstring>

#include "core/volume/min_max.h"

namespace isoscope::partition {
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
