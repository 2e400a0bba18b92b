// Cuts blocks out of a slab of planes, and finds their spans.

#ifndef ISOSCOPE_CORE_PARTITION_BLOCK_CUTTER_H_
#define ISOSCOPE_CORE_PARTITION_BLOCK_CUTTER_H_

#include <cstdint>

#include "core/volume/block_layout.h"
#include "core/volume/scalar_span.h"
#include "core/volume/scalar_type.h"

namespace isoscope::partition {

// Rows [begin_y, begin_y + rows) of planes [begin_z, ...) of a volume, [z][y][x], x fastest,
// little-endian, any alignment. Does not own the samples.
struct Slab {
  const char* samples = nullptr;
  std::int64_t begin_z = 0;
  std::int64_t begin_y = 0;
  std::int64_t rows = 0;  // of each plane; 0: all of the volume's
};

// The span of a block's own samples: ghost samples and NaN left out. A function of the samples
// alone, also where they hold zeros of both signs. Thread-safe.
// REQUIRES: `slab` holds the rows of OwnSamplesOf(id).
volume::ScalarSpan SpanOfBlock(const volume::BlockLayout& layout, volume::ScalarType type,
                               const Slab& slab, volume::BlockId id);

// Copies a block's stored samples to `out`, volume::StoredSizeBytes(layout, id, type) bytes.
// Thread-safe. REQUIRES: `slab` holds the rows of StoredSamplesOf(id).
void CutBlock(const volume::BlockLayout& layout, volume::ScalarType type, const Slab& slab,
              volume::BlockId id, char* out);

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_BLOCK_CUTTER_H_
