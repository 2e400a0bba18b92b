// The samples of one block, as read from a shard.

#ifndef ISOSCOPE_CORE_VOLUME_BLOCK_SAMPLES_H_
#define ISOSCOPE_CORE_VOLUME_BLOCK_SAMPLES_H_

#include <cstddef>
#include <string>

#include "core/math/box.h"
#include "core/volume/block_layout.h"
#include "core/volume/scalar_type.h"

namespace isoscope::volume {

// A non-owning view. `bytes` holds [z][y][x] samples of BlockLayout::StoredSamplesOf(block_id),
// x fastest, little-endian, any alignment.
struct BlockSamples {
  BlockId block_id = 0;
  ScalarType type = ScalarType::kUint8;
  const char* bytes = nullptr;  // StoredSizeBytes(layout, block_id, type) of them
};

// Returns the stored size of a block, uncompressed.
inline std::size_t StoredSizeBytes(const BlockLayout& layout, BlockId id, ScalarType type) {
  return static_cast<std::size_t>(math::Volume(layout.StoredSamplesOf(id).dims())) * SizeOf(type);
}

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_BLOCK_SAMPLES_H_
