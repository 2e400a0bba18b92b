// Which pixels of a rectangle count.

#ifndef ISOSCOPE_CORE_IMAGE_PIXEL_MASK_H_
#define ISOSCOPE_CORE_IMAGE_PIXEL_MASK_H_

#include <cstddef>
#include <cstdint>
#include <vector>

namespace isoscope::image {

// One bit for each cell of 2^shift x 2^shift pixels (cells are aligned to pixel 0), row by row:
// cell (column, row) is bit column + row * columns. Thread-compatible.
struct PixelMask {
  int shift = 0;
  int begin_column = 0;  // the first cell is (begin_column, begin_row) of the image's
  int begin_row = 0;
  int columns = 0;
  int rows = 0;
  std::vector<std::uint64_t> words;  // ceil(columns * rows / 64); spare bits are 0

  // False outside the rectangle.
  [[nodiscard]] bool Contains(int x, int y) const {
    const int column = (x >> shift) - begin_column;
    const int row = (y >> shift) - begin_row;
    if (column < 0 || row < 0 || column >= columns || row >= rows) {
      return false;
    }
    const auto bit = static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
                     static_cast<std::size_t>(column);
    return (words[bit / 64] >> (bit % 64) & 1) != 0;
  }

  friend bool operator==(const PixelMask&, const PixelMask&) = default;
};

}  // namespace isoscope::image

#endif  // ISOSCOPE_CORE_IMAGE_PIXEL_MASK_H_
