// The span of every block of the whole volume: the table that every agent and the coordinator hold,
// so that rays are cast without reading a sample.

#ifndef ISOSCOPE_CORE_VOLUME_RANGE_TABLE_H_
#define ISOSCOPE_CORE_VOLUME_RANGE_TABLE_H_

#include <cstdint>
#include <string>

#include "core/volume/block_layout.h"
#include "core/volume/block_set.h"
#include "core/volume/scalar_span.h"
#include "core/volume/scalar_type.h"

namespace isoscope::volume {

// Spans by BlockId, kept in the sample type: two values a block. Immutable after it was filled;
// then thread-safe.
class RangeTable {
 public:
  RangeTable() = default;
  // All spans empty (never active).
  RangeTable(ScalarType type, std::int64_t block_count);

  [[nodiscard]] ScalarType type() const { return type_; }
  [[nodiscard]] std::int64_t block_count() const { return block_count_; }

  // REQUIRES: both ends are values of the sample type, or the span is empty. An empty span is kept
  // as (largest, lowest) of the type, for floats (+inf, -inf).
  void Set(BlockId id, const ScalarSpan& span);
  [[nodiscard]] ScalarSpan Get(BlockId id) const;
  // The span of the whole volume.
  [[nodiscard]] ScalarSpan Total() const;

  // The blocks with IsActive(Get(id), isovalue). REQUIRES: isovalue is finite. O(block_count).
  [[nodiscard]] BlockSet ActiveBlocks(double isovalue) const;

  // The table as it stands in files: min, max of block 0, min, max of block 1, ..., in the sample
  // type, little-endian: 2 * SizeOf(type) * block_count bytes.
  [[nodiscard]] const std::string& bytes() const { return bytes_; }
  // REQUIRES: bytes.size() == 2 * SizeOf(type) * block_count.
  static RangeTable FromBytes(ScalarType type, std::int64_t block_count, std::string bytes);

 private:
  ScalarType type_ = ScalarType::kUint8;
  std::int64_t block_count_ = 0;
  std::string bytes_;
};

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_RANGE_TABLE_H_
