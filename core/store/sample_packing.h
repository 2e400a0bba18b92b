// Packs the samples of a block as differences of few bits (docs/format/shard.md, "Packed blocks").

#ifndef ISOSCOPE_CORE_STORE_SAMPLE_PACKING_H_
#define ISOSCOPE_CORE_STORE_SAMPLE_PACKING_H_

#include <cstddef>
#include <string>

#include "absl/strings/string_view.h"

#include "core/math/vec.h"

namespace isoscope::store {

// Bytes of a sample that can be packed: 1, 2 or 4. Floats of 4 bytes are packed as integers.
inline constexpr std::size_t kMaxPackedWidth = 4;

// Packs into `*out`, which then has the packed size. False if that would not be smaller than the
// samples: then `*out` holds nothing of use. Thread-safe.
//
// width:   bytes of a sample, 1, 2 or 4
// dims:    samples on each axis, at least 1
// samples: [z][y][x], x fastest, little-endian
bool PackSamples(std::size_t width, const math::Index3& dims, absl::string_view samples,
                 std::string* out);

// Unpacks to `out`. Safe for any bytes: reads and writes stay within `packed`, `*scratch` and
// `out`. False if `packed` is not as long as its widths say. Thread-safe.
//
// scratch: overwritten; pass the same string again to avoid allocations
// out:     width bytes for each sample of dims
bool UnpackSamples(std::size_t width, const math::Index3& dims, absl::string_view packed,
                   std::string* scratch, char* out);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_SAMPLE_PACKING_H_
