// Boxes of arrays of any rank, and the chunks that they meet.

#ifndef ISOSCOPE_CORE_SOURCE_CHUNKS_CHUNK_BOX_H_
#define ISOSCOPE_CORE_SOURCE_CHUNKS_CHUNK_BOX_H_

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"

namespace isoscope::source {

// One number for each axis, the slowest one first.
using ChunkIndex = std::vector<std::int64_t>;

// The most axes of an array, as in NumPy.
inline constexpr std::size_t kMaxChunkAxes = 32;

// Elements [begin, end) along each axis.
struct ChunkBox {
  ChunkIndex begin{};
  ChunkIndex end{};

  [[nodiscard]] bool is_empty() const;
  friend bool operator==(const ChunkBox&, const ChunkBox&) = default;
};
ChunkBox IntersectionOf(const ChunkBox& a, const ChunkBox& b);
// The whole array.
ChunkBox BoxOf(const ChunkIndex& dims);

// "(4, 8, 8)".
std::string DescribeIndex(const ChunkIndex& index);

// The product; -1 if it, or it times `element_size`, is above `limit`. 1 for no axes.
// REQUIRES: dims >= 0.
std::int64_t CheckedVolume(const ChunkIndex& dims, std::int64_t element_size, std::int64_t limit);

// Chunks of one size that cover an array, from its first element on; the last ones may reach beyond
// its end.
class ChunkGrid {
 public:
  // REQUIRES: as many sizes of chunks as of the array; sizes of chunks > 0.
  ChunkGrid(ChunkIndex dims, ChunkIndex chunk_dims);

  [[nodiscard]] const ChunkIndex& dims() const { return dims_; }
  [[nodiscard]] const ChunkIndex& chunk_dims() const { return chunk_dims_; }
  [[nodiscard]] const ChunkIndex& counts() const { return counts_; }
  // The elements of a chunk, those beyond the end of the array included.
  [[nodiscard]] ChunkBox ElementsOf(const ChunkIndex& chunk) const;
  // The chunks that have elements of the box. REQUIRES: the box lies in the array, is not empty.
  [[nodiscard]] ChunkBox ChunksOf(const ChunkBox& box) const;
  // The chunk's number in C order.
  [[nodiscard]] std::int64_t NumberOf(const ChunkIndex& chunk) const;

 private:
  ChunkIndex dims_;
  ChunkIndex chunk_dims_;
  ChunkIndex counts_;
};

// Goes to the next index of a box in C order. Returns false behind the last one.
bool NextIndex(const ChunkBox& box, ChunkIndex* index);

// Copies `part` from an array that has the elements of `from_box` to one that has those of
// `to_box`; both in C order. REQUIRES: both have the part, which is not empty.
void CopyPart(const ChunkBox& part, std::size_t element_size, const ChunkBox& from_box,
              const char* from, const ChunkBox& to_box, char* to);
// Writes one element all over a part.
void FillPart(const ChunkBox& part, absl::string_view element, const ChunkBox& to_box, char* to);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_CHUNKS_CHUNK_BOX_H_
