// Cuts blocks out of a slab of planes, and finds their spans.

#ifndef ISOSCOPE_CORE_PARTITION_BLOCK_CUTTER_H_
#define ISOSCOPE_CORE_PARTITION_BLOCK_CUTTER_H_

#include <cstddef>
#include <cstdint>

#include "core/math/box.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_samples.h"
#include "core/volume/scalar_span.h"
#include "core/volume/scalar_type.h"

namespace isoscope::partition {

// A non-owning view of rows [begin_y, begin_y + rows) of planes [begin_z, ...) of a volume:
// [z][y][x], x fastest, little-endian, any alignment.
struct Slab {
  const char* samples = nullptr;
  std::int64_t begin_z = 0;
  std::int64_t begin_y = 0;
  std::int64_t rows = 0;  // of each plane; 0: all rows of the volume
};

// Calls visit(row, sample count) for each row of `box`, in the order of memory. `row` points to
// samples of `sample_size` bytes. REQUIRES: `slab` holds the rows of `box`.
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

// Calls visit(row, sample count) for each row of `box`, in the order of memory. REQUIRES: `box` lies
// within the block's stored samples.
template <typename Visit>
void ForEachRow(const volume::BlockLayout& layout, const volume::BlockSamples& samples,
                const math::IndexBox& box, const Visit& visit) {
  const math::IndexBox stored = layout.StoredSamplesOf(samples.block_id);
  const math::Index3 dims = stored.dims();
  const auto count = static_cast<std::size_t>(box.end.x - box.begin.x);
  const std::size_t sample_size = volume::SizeOf(samples.type);
  for (std::int64_t z = box.begin.z; z < box.end.z; ++z) {
    for (std::int64_t y = box.begin.y; y < box.end.y; ++y) {
      const std::int64_t first = ((z - stored.begin.z) * dims.y + y - stored.begin.y) * dims.x +
                                 box.begin.x - stored.begin.x;
      visit(samples.bytes + static_cast<std::size_t>(first) * sample_size, count);
    }
  }
}

// Returns the span of a block's own samples: ghost samples and NaN left out. Zeros of either sign
// give the same span. Thread-safe. REQUIRES: `slab` holds the rows of OwnSamplesOf(id).
volume::ScalarSpan SpanOfBlock(const volume::BlockLayout& layout, volume::ScalarType type,
                               const Slab& slab, volume::BlockId id);
// The same of a block that is cut already: its rows lie close together, so this is faster.
volume::ScalarSpan SpanOfBlock(const volume::BlockLayout& layout,
                               const volume::BlockSamples& samples);

// Copies a block's stored samples to `out`, volume::StoredSizeBytes(layout, id, type) bytes.
// Thread-safe. REQUIRES: `slab` holds the rows of StoredSamplesOf(id).
void CutBlock(const volume::BlockLayout& layout, volume::ScalarType type, const Slab& slab,
              volume::BlockId id, char* out);

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_BLOCK_CUTTER_H_
