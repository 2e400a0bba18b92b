// The pixels of an image that something may cover, row of tiles by row of tiles.

#ifndef ISOSCOPE_CORE_PICTURE_COVERED_PIXELS_H_
#define ISOSCOPE_CORE_PICTURE_COVERED_PIXELS_H_

#include <bit>
#include <cstddef>

#include "core/image/frame_image.h"

namespace isoscope::picture {

// Calls fn(x, y, pixel index) for each covered pixel of a row of tiles. Some may be background.
template <typename Fn>
void ForEachCoveredInRow(const image::FrameImage& image, int row, const Fn& fn) {
  constexpr int kTilePx = image::TileSet::kTilePx;
  image.touched.ForEachInRow(row, [&](int column) {
    const image::TileMask& covered = image.CoveredOf(column, row);
    for (std::size_t k = 0; k < covered.size(); ++k) {
      const int y = row * kTilePx + static_cast<int>(k);
      for (unsigned rest = covered[k]; rest != 0; rest &= rest - 1) {
        const int x = column * kTilePx + std::countr_zero(rest);
        fn(x, y, image.IndexOf(x, y));
      }
    }
  });
}

}  // namespace isoscope::picture

#endif  // ISOSCOPE_CORE_PICTURE_COVERED_PIXELS_H_
