// Decodes the bytes of a band into pixels.

#ifndef ISOSCOPE_CORE_COMPOSITE_BAND_DECODER_H_
#define ISOSCOPE_CORE_COMPOSITE_BAND_DECODER_H_

#include <cstdint>
#include <memory>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/composite/band_format.h"
#include "core/composite/tile_prediction.h"
#include "core/image/fragment.h"
#include "core/image/frame_image.h"

namespace isoscope::composite {

// The covered pixels of a band, tile by tile, and row by row in a tile.
struct BandPixels {
  bool is_layer = false;        // BandHeader
  std::vector<TileArea> areas;  // of tiles with a covered pixel, in rows from the top
  std::vector<TileMask> masks;  // the covered pixels of each
  std::unique_ptr<std::uint64_t[]> keys;
  std::unique_ptr<image::Rgba8[]> colors;
};

// Decodes a band of an image that has the size of `image`. DATA_LOSS if the bytes are damaged,
// don't fit that size, or name owners beyond `surfaces`. O(pixels). Thread-safe.
absl::StatusOr<BandPixels> DecodeBand(absl::string_view band, const image::FrameImage& image,
                                      const image::FragmentOrder& order,
                                      const SurfaceCounts& surfaces);

}  // namespace isoscope::composite

#endif  // ISOSCOPE_CORE_COMPOSITE_BAND_DECODER_H_
