// From the ranges that a reader wants to the ranges that are requested: neighbours are joined, what
// is long is split.
//
//   wanted      |aaaa|  |bb|                      |cccccccccccccccccccc|
//   requested   |----------|                      |---------||---------|
//
// A gap costs its bytes, a request costs a round trip; so a short gap is read and dropped. Ranges may
// overlap: their bytes are requested once, and copied to each.

#ifndef ISOSCOPE_CORE_SOURCE_REMOTE_RANGE_PLAN_H_
#define ISOSCOPE_CORE_SOURCE_REMOTE_RANGE_PLAN_H_

#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/strings/string_view.h"
#include "absl/types/span.h"

#include "core/source/bytes/byte_source.h"

namespace isoscope::source {

// One request: bytes [begin, end) of the object, and the parts of the ranges that lie in them, by
// offset.
struct RangePiece {
  std::int64_t begin = 0;
  std::int64_t end = 0;
  std::vector<ByteRange> parts;
};

struct RangeRules {
  std::int64_t max_gap_bytes = 0;    // between two ranges of one request
  std::int64_t max_piece_bytes = 1;  // of one request
};

// Returns requests that cover `ranges`, by offset; they do not overlap. Ranges of no bytes need none.
// REQUIRES: each range lies within the object; max_piece_bytes >= 1.
// Complexity: O(n log n), and one part for each range and piece that it lies in.
std::vector<RangePiece> PlanRanges(absl::Span<const ByteRange> ranges, const RangeRules& rules);

// Copies the bytes of a piece to its parts, as they come. Thread-compatible.
class PieceWriter {
 public:
  // `piece` outlives it.
  explicit PieceWriter(const RangePiece& piece) : piece_(piece), position_(piece.begin) {}

  // The bytes at position(). REQUIRES: they lie within the piece.
  void Append(absl::string_view bytes);
  [[nodiscard]] std::int64_t position() const { return position_; }
  [[nodiscard]] std::int64_t left_bytes() const { return piece_.end - position_; }

 private:
  const RangePiece& piece_;
  std::int64_t position_;
  std::size_t first_part_ = 0;  // all before it have ended
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_REMOTE_RANGE_PLAN_H_
