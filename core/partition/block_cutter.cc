#include "core/partition/block_cutter.h"

#include <cstddef>
#include <cstring>

#include "core/volume/min_max.h"

namespace isoscope::partition {
namespace {

// Copies a row of a block. Rows are short: a call of memcpy takes longer than the copy.
void CopyRow(const char* row, std::size_t size, char* out) {
  constexpr std::size_t kStep = 16;
  if (size < kStep) {
    std::memcpy(out, row, size);
    return;
  }
  std::size_t i = 0;
  for (; i + kStep <= size; i += kStep) {
    std::memcpy(out + i, row + i, kStep);
  }
  // Overlaps the step before.
  std::memcpy(out + size - kStep, row + size - kStep, kStep);
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

volume::ScalarSpan SpanOfBlock(const volume::BlockLayout& layout,
                               const volume::BlockSamples& samples) {
  return volume::VisitScalarType(samples.type, [&]<typename T>() {
    volume::MinMax<T> min_max;
    ForEachRow(layout, samples, layout.OwnSamplesOf(samples.block_id),
               [&](const char* row, std::size_t count) { min_max.AddRow(row, count); });
    return min_max.Get();
  });
}

void CutBlock(const volume::BlockLayout& layout, volume::ScalarType type, const Slab& slab,
              volume::BlockId id, char* out) {
  const std::size_t sample_size = volume::SizeOf(type);
  ForEachRow(layout, sample_size, slab, layout.StoredSamplesOf(id),
             [&](const char* row, std::size_t count) {
               CopyRow(row, count * sample_size, out);
               out += count * sample_size;
             });
}

}  // namespace isoscope::partition
