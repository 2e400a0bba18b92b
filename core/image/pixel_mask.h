// A mask of the pixels of a rectangle, in cells of one or more pixels.

#ifndef ISOSCOPE_CORE_IMAGE_PIXEL_MASK_H_
#define ISOSCOPE_CORE_IMAGE_PIXEL_MASK_H_

#include <cstddef>
#include <cstdint>
#include <vector>

namespace isoscope::image {

// One bit for each cell of 2^shift x 2^shift pixels, row by row: cell (column, row) of the mask is
// bit column + row * columns. Cells are aligned to pixel 0 of the image. Thread-compatible.
//
// Example: shift 1, begin (3, 5), 4 columns: pixel (9, 12) lies in the image's cell (4, 6), which
// is cell (1, 1) of the mask: bit 5.
struct PixelMask {
  int shift = 0;
  int begin_column = 0;  // the mask's first cell, counted in cells of the image
  int begin_row = 0;
  int columns = 0;
  int rows = 0;
  std::vector<std::uint64_t> words;  // ceil(columns * rows / 64); spare bits are 0

  // Returns the bit of a pixel; false outside the rectangle.
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
