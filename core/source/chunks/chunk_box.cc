#include "core/source/chunks/chunk_box.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "core/base/check.h"

namespace isoscope::source {
namespace {

// Bytes from one element to the next along each axis.
std::vector<std::int64_t> StridesOf(const ChunkBox& box, std::size_t element_size) {
  std::vector<std::int64_t> strides(box.begin.size());
  auto stride = static_cast<std::int64_t>(element_size);
  for (std::size_t axis = strides.size(); axis-- > 0;) {
    strides[axis] = stride;
    stride *= box.end[axis] - box.begin[axis];
  }
  return strides;
}

std::int64_t OffsetOf(const ChunkIndex& index, const ChunkBox& box,
                      const std::vector<std::int64_t>& strides) {
  std::int64_t offset = 0;
  for (std::size_t axis = 0; axis < index.size(); ++axis) {
    offset += (index[axis] - box.begin[axis]) * strides[axis];
  }
  return offset;
}

// Calls visit(index) for the first element of each row of the part. Axes from `row_axis` on are one
// row.
template <typename Visit>
void VisitRows(const ChunkBox& part, std::size_t row_axis, const Visit& visit) {
  ChunkBox rows = part;
  for (std::size_t axis = row_axis; axis < part.begin.size(); ++axis) {
    rows.end[axis] = part.begin[axis] + 1;
  }
  ChunkIndex index = rows.begin;
  do {
    visit(index);
  } while (NextIndex(rows, &index));
}

}  // namespace

bool ChunkBox::is_empty() const {
  for (std::size_t axis = 0; axis < begin.size(); ++axis) {
    if (begin[axis] >= end[axis]) {
      return true;
    }
  }
  return false;
}

ChunkBox IntersectionOf(const ChunkBox& a, const ChunkBox& b) {
  ChunkBox both = a;
  for (std::size_t axis = 0; axis < both.begin.size(); ++axis) {
    both.begin[axis] = std::max(a.begin[axis], b.begin[axis]);
    both.end[axis] = std::min(a.end[axis], b.end[axis]);
  }
  return both;
}

ChunkBox BoxOf(const ChunkIndex& dims) {
  return {.begin = ChunkIndex(dims.size(), 0), .end = dims};
}

std::string DescribeIndex(const ChunkIndex& index) {
  return absl::StrCat("(", absl::StrJoin(index, ", "), ")");
}

std::int64_t CheckedVolume(const ChunkIndex& dims, std::int64_t element_size, std::int64_t limit) {
  if (std::find(dims.begin(), dims.end(), 0) != dims.end()) {
    return 0;
  }
  std::int64_t volume = 1;
  for (const std::int64_t size : dims) {
    if (size > limit / volume) {
      return -1;
    }
    volume *= size;
  }
  return volume > limit / element_size ? -1 : volume;
}

ChunkGrid::ChunkGrid(ChunkIndex dims, ChunkIndex chunk_dims)
    : dims_(std::move(dims)), chunk_dims_(std::move(chunk_dims)) {
  ISOSCOPE_CHECK_EQ(dims_.size(), chunk_dims_.size());
  for (std::size_t axis = 0; axis < dims_.size(); ++axis) {
    counts_.push_back(dims_[axis] / chunk_dims_[axis] +
                      (dims_[axis] % chunk_dims_[axis] == 0 ? 0 : 1));
  }
}

ChunkBox ChunkGrid::ElementsOf(const ChunkIndex& chunk) const {
  ChunkBox box{.begin = chunk, .end = chunk};
  for (std::size_t axis = 0; axis < chunk.size(); ++axis) {
    box.begin[axis] *= chunk_dims_[axis];
    box.end[axis] = box.begin[axis] + chunk_dims_[axis];
  }
  return box;
}

ChunkBox ChunkGrid::ChunksOf(const ChunkBox& box) const {
  ChunkBox chunks = box;
  for (std::size_t axis = 0; axis < dims_.size(); ++axis) {
    chunks.begin[axis] /= chunk_dims_[axis];
    chunks.end[axis] = (chunks.end[axis] - 1) / chunk_dims_[axis] + 1;
  }
  return chunks;
}

std::int64_t ChunkGrid::NumberOf(const ChunkIndex& chunk) const {
  std::int64_t number = 0;
  for (std::size_t axis = 0; axis < chunk.size(); ++axis) {
    number = number * counts_[axis] + chunk[axis];
  }
  return number;
}

bool NextIndex(const ChunkBox& box, ChunkIndex* index) {
  for (std::size_t axis = index->size(); axis-- > 0;) {
    if (++(*index)[axis] < box.end[axis]) {
      return true;
    }
    (*index)[axis] = box.begin[axis];
  }
  return false;
}

void CopyPart(const ChunkBox& part, std::size_t element_size, const ChunkBox& from_box,
              const char* from, const ChunkBox& to_box, char* to) {
  const std::vector<std::int64_t> from_strides = StridesOf(from_box, element_size);
  const std::vector<std::int64_t> to_strides = StridesOf(to_box, element_size);
  // The longest runs that lie together in both.
  std::size_t row_axis = part.begin.size();
  auto row_bytes = static_cast<std::int64_t>(element_size);
  while (row_axis > 0 && from_strides[row_axis - 1] == row_bytes &&
         to_strides[row_axis - 1] == row_bytes) {
    --row_axis;
    row_bytes *= part.end[row_axis] - part.begin[row_axis];
  }
  if (row_axis == 0) {
    std::memcpy(to + OffsetOf(part.begin, to_box, to_strides),
                from + OffsetOf(part.begin, from_box, from_strides),
                static_cast<std::size_t>(row_bytes));
    return;
  }
  // Rows along the axis in front of them have places that go up by strides.
  const std::size_t inner = row_axis - 1;
  const std::int64_t count = part.end[inner] - part.begin[inner];
  VisitRows(part, inner, [&](const ChunkIndex& index) {
    char* out = to + OffsetOf(index, to_box, to_strides);
    const char* in = from + OffsetOf(index, from_box, from_strides);
    for (std::int64_t i = 0; i < count; ++i) {
      std::memcpy(out, in, static_cast<std::size_t>(row_bytes));
      out += to_strides[inner];
      in += from_strides[inner];
    }
  });
}

void FillPart(const ChunkBox& part, absl::string_view element, const ChunkBox& to_box, char* to) {
  const std::vector<std::int64_t> strides = StridesOf(to_box, element.size());
  std::size_t row_axis = part.begin.size();
  auto row_bytes = static_cast<std::int64_t>(element.size());
  while (row_axis > 0 && strides[row_axis - 1] == row_bytes) {
    --row_axis;
    row_bytes *= part.end[row_axis] - part.begin[row_axis];
  }
  const bool is_one_byte = element.find_first_not_of(element[0]) == absl::string_view::npos;
  VisitRows(part, row_axis, [&](const ChunkIndex& index) {
    char* const row = to + OffsetOf(index, to_box, strides);
    const auto size = static_cast<std::size_t>(row_bytes);
    if (is_one_byte) {
      std::memset(row, element[0], size);
      return;
    }
    std::memcpy(row, element.data(), element.size());
    for (std::size_t done = element.size(); done < size;) {  // twice as much each time
      const std::size_t count = std::min(done, size - done);
      std::memcpy(row + done, row, count);
      done += count;
    }
  });
}

}  // namespace isoscope::source
