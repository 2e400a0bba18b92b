// Cuts blocks out of a slab of planes, and finds their spans.

#ifndef ISOSCOPE_CORE_PARTITION_BLOCK_CUTTER_H_
#define ISOSCOPE_CORE_PARTITION_BLOCK_CUTTER_H_

#include <cstdint>

#include "core/volume/block_layout.h"
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

// Returns the span of a block's own samples: ghost samples and NaN left out. Zeros of either sign
// give the same span. Thread-safe. REQUIRES: `slab` holds the rows of OwnSamplesOf(id).
volume::ScalarSpan SpanOfBlock(const volume::BlockLayout& layout, volume::ScalarType type,
                               const Slab& slab, volume::BlockId id);

// Copies a block's stored samples to `out`, volume::StoredSizeBytes(layout, id, type) bytes.
// Thread-safe. REQUIRES: `slab` holds the rows of StoredSamplesOf(id).
void CutBlock(const volume::BlockLayout& layout, volume::ScalarType type, const Slab& slab,
              volume::BlockId id, char* out);

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_BLOCK_CUTTER_H_
