// Sparse, compressed pixels on the wire: only covered pixels, in tiles, one Zstandard frame for a
// band of tile rows, so that bands can be sent and composited as they are made. The byte layout is
// in docs/format/wire.md.

#ifndef ISOSCOPE_CORE_COMPOSITE_PIXEL_CODEC_H_
#define ISOSCOPE_CORE_COMPOSITE_PIXEL_CODEC_H_

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/strings/string_view.h"

#include "core/image/frame_image.h"

namespace isoscope::composite {

// Encodes the pixels of `image` that are not background and that `keep(x, y)` accepts (all if
// null), as bands of whole tile rows; each band is at most kMaxBandBytes long before compression.
// No covered pixel: no band.
std::vector<std::string> EncodePixels(const image::FrameImage& image,
                                      const std::function<bool(int x, int y)>& keep);
inline constexpr std::int64_t kMaxBandBytes = std::int64_t{3} << 20;

// Composites the pixels of one band into `into` (CompositeInto's rule). DATA_LOSS if the bytes are
// damaged or don't fit the image; then `into` is unchanged.
absl::Status DecodePixelsInto(absl::string_view band, image::FrameImage* into);

}  // namespace isoscope::composite

#endif  // ISOSCOPE_CORE_COMPOSITE_PIXEL_CODEC_H_
