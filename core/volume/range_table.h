// The span of every block of the whole volume. Every agent holds this table, so that step 1 finds
// the active blocks and casts rays without reading a sample. File: docs/format/dataset.md,
// "ranges.bin".

#ifndef ISOSCOPE_CORE_VOLUME_RANGE_TABLE_H_
#define ISOSCOPE_CORE_VOLUME_RANGE_TABLE_H_

#include <cstdint>
#include <string>

#include "core/volume/block_layout.h"
#include "core/volume/block_set.h"
#include "core/volume/inside_rule.h"
#include "core/volume/scalar_span.h"
#include "core/volume/scalar_type.h"

namespace isoscope::volume {

// Spans by block id, kept in the sample type: two values a block. Thread-compatible; thread-safe
// once it is no longer changed.
class RangeTable {
 public:
  RangeTable() = default;
  // Makes a table whose spans are all empty: never active.
  RangeTable(ScalarType type, std::int64_t block_count);

  [[nodiscard]] ScalarType type() const { return type_; }
  [[nodiscard]] std::int64_t block_count() const { return block_count_; }

  // Sets a span. An empty one is kept as (largest, lowest) of the type, for floats (+inf, -inf).
  // REQUIRES: both ends are values of the sample type, or the span is empty.
  void Set(BlockId id, const ScalarSpan& span);
  [[nodiscard]] ScalarSpan Get(BlockId id) const;
  // Returns the span of the whole volume. O(block_count).
  [[nodiscard]] ScalarSpan Total() const;

  // Returns the blocks with IsActive(Get(id), isovalue). REQUIRES: isovalue is finite.
  // O(block_count).
  [[nodiscard]] BlockSet ActiveBlocks(double isovalue) const;
  // Returns the blocks with rule.IsActive(Get(id)). O(block_count), times the logarithm of the
  // labels.
  [[nodiscard]] BlockSet ActiveBlocks(const InsideRule& rule) const;

  // The table as it lies in files: min and max of block 0, min and max of block 1, ..., in the
  // sample type, little-endian: 2 * SizeOf(type) * block_count bytes.
  [[nodiscard]] const std::string& bytes() const { return bytes_; }
  // Makes a table of such bytes. Any values are accepted.
  // REQUIRES: bytes.size() == 2 * SizeOf(type) * block_count.
  static RangeTable FromBytes(ScalarType type, std::int64_t block_count, std::string bytes);

  friend bool operator==(const RangeTable&, const RangeTable&) = default;

 private:
  ScalarType type_ = ScalarType::kUint8;
  std::int64_t block_count_ = 0;
  std::string bytes_;
};

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_RANGE_TABLE_H_
