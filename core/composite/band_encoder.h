// Encodes covered pixels into the bytes of a band.

#ifndef ISOSCOPE_CORE_COMPOSITE_BAND_ENCODER_H_
#define ISOSCOPE_CORE_COMPOSITE_BAND_ENCODER_H_

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "core/composite/band_format.h"
#include "core/composite/tile_prediction.h"
#include "core/image/frame_image.h"

namespace isoscope::composite {

// The tiles of one row that have a covered pixel.
struct TileRow {
  std::vector<TileArea> areas;
  std::vector<TileMask> masks;
  std::size_t pixel_count = 0;
};

// Rows of tiles [begin, end).
struct BandRows {
  int begin = 0;
  int end = 0;
};

// Encodes some rows of tiles of `image`. The first and the last of them have a covered pixel, and
// `tiles` has an element for each row. is_layer: as BandHeader. O(pixels). Thread-safe.
std::string EncodeBand(const image::FrameImage& image, BandRows rows,
                       std::span<const TileRow> tiles, bool is_layer = false);

}  // namespace isoscope::composite

#endif  // ISOSCOPE_CORE_COMPOSITE_BAND_ENCODER_H_
