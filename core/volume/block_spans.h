// The spans of single blocks, wherever the range table is: in memory, or in pages that are loaded
// on the way.

#ifndef ISOSCOPE_CORE_VOLUME_BLOCK_SPANS_H_
#define ISOSCOPE_CORE_VOLUME_BLOCK_SPANS_H_

#include <array>
#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/status.h"

#include "core/volume/block_layout.h"
#include "core/volume/range_table.h"
#include "core/volume/scalar_span.h"
#include "core/volume/scalar_type.h"
#include "core/volume/span_octree.h"

namespace isoscope::volume {

// Returns the span that holds every value of a type.
ScalarSpan WidestSpan(ScalarType type);

// Reads spans by block id. Of an octree it keeps the pages around the last block, at most 8, so that
// blocks and their neighbours cost no look into shared pages. The table or octree must outlive it.
// Thread-compatible: each thread has its own.
class BlockSpans {
 public:
  explicit BlockSpans(const RangeTable& table);
  explicit BlockSpans(const SpanOctree& octree);

  [[nodiscard]] ScalarType type() const { return type_; }
  // Returns the span of a block. If its page can't be read, that is WidestSpan, so that no work is
  // left out, and status() has the error. REQUIRES: the block exists.
  [[nodiscard]] ScalarSpan Get(BlockId id) {
    return table_ != nullptr ? table_->Get(id) : FromPage(id);
  }
  // The first error of a page: as SpanPages::Load.
  [[nodiscard]] const absl::Status& status() const { return status_; }

 private:
  struct KeptPage {
    std::int64_t page = -1;
    std::shared_ptr<const std::string> bytes;  // null: it can't be read
  };

  ScalarSpan FromPage(BlockId id);

  const RangeTable* table_ = nullptr;  // null: of the octree
  const SpanOctree* octree_ = nullptr;
  ScalarType type_;
  std::array<KeptPage, 8> kept_;  // by the parity of the page's index on each axis
  absl::Status status_;
};

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_BLOCK_SPANS_H_
