// Three steps:
//
// 1. Sort the ranges by offset.
// 2. Join: a run grows while the next range begins at most max_gap_bytes behind its end.
// 3. Split each run into equal pieces of at most max_piece_bytes; give each piece its parts. A piece
//    that would begin or end in a gap keeps it: gaps are short.

#include "core/source/remote/range_plan.h"

#include <algorithm>
#include <cstring>

#include "core/base/check.h"

namespace isoscope::source {
namespace {

std::int64_t EndOf(const ByteRange& range) {
  return range.offset + static_cast<std::int64_t>(range.size);
}

// The part of `range` that lies in [begin, end). REQUIRES: there is one.
ByteRange PartWithin(const ByteRange& range, std::int64_t begin, std::int64_t end) {
  const std::int64_t first = std::max(begin, range.offset);
  return {.offset = first,
          .size = static_cast<std::size_t>(std::min(end, EndOf(range)) - first),
          .out = range.out + (first - range.offset)};
}

// `run`: sorted ranges that are joined.
void SplitRun(absl::Span<const ByteRange> run, std::int64_t run_end, std::int64_t max_piece_bytes,
              std::vector<RangePiece>* pieces) {
  const std::int64_t run_begin = run.front().offset;
  const std::int64_t size = run_end - run_begin;
  const std::int64_t count = (size - 1) / max_piece_bytes + 1;
  const std::size_t first_piece = pieces->size();
  // Of equal size, but for the rest: the first ones have a byte more.
  std::int64_t begin = run_begin;
  for (std::int64_t i = 0; i < count; ++i) {
    const std::int64_t end = begin + size / count + (i < size % count ? 1 : 0);
    pieces->push_back({.begin = begin, .end = end, .parts = {}});
    begin = end;
  }
  std::size_t piece_index = first_piece;  // all pieces before it end before the range begins
  for (const ByteRange& range : run) {
    while ((*pieces)[piece_index].end <= range.offset) {
      ++piece_index;
    }
    for (std::size_t i = piece_index; i < pieces->size() && (*pieces)[i].begin < EndOf(range);
         ++i) {
      RangePiece& piece = (*pieces)[i];
      piece.parts.push_back(PartWithin(range, piece.begin, piece.end));
    }
  }
}

}  // namespace

std::vector<RangePiece> PlanRanges(absl::Span<const ByteRange> ranges, const RangeRules& rules) {
  std::vector<ByteRange> sorted;
  sorted.reserve(ranges.size());
  std::copy_if(ranges.begin(), ranges.end(), std::back_inserter(sorted),
               [](const ByteRange& range) { return range.size > 0; });
  std::stable_sort(sorted.begin(), sorted.end(),
                   [](const ByteRange& a, const ByteRange& b) { return a.offset < b.offset; });
  std::vector<RangePiece> pieces;
  for (std::size_t begin = 0; begin < sorted.size();) {
    std::int64_t run_end = EndOf(sorted[begin]);
    std::size_t end = begin + 1;
    for (; end < sorted.size() && sorted[end].offset - run_end <= rules.max_gap_bytes; ++end) {
      run_end = std::max(run_end, EndOf(sorted[end]));
    }
    SplitRun(absl::MakeConstSpan(sorted).subspan(begin, end - begin), run_end,
             rules.max_piece_bytes, &pieces);
    begin = end;
  }
  return pieces;
}

void PieceWriter::Append(absl::string_view bytes) {
  const std::int64_t end = position_ + static_cast<std::int64_t>(bytes.size());
  ISOSCOPE_CHECK(end <= piece_.end);
  const std::vector<ByteRange>& parts = piece_.parts;
  while (first_part_ < parts.size() && EndOf(parts[first_part_]) <= position_) {
    ++first_part_;
  }
  for (std::size_t i = first_part_; i < parts.size() && parts[i].offset < end; ++i) {
    if (EndOf(parts[i]) > position_) {
      const ByteRange part = PartWithin(parts[i], position_, end);
      std::memcpy(part.out, bytes.data() + (part.offset - position_), part.size);
    }
  }
  position_ = end;
}

}  // namespace isoscope::source
