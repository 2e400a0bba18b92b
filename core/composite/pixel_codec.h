// Sparse pixels on the wire: only covered ones, as what differs from what their neighbours let one
// expect, in bands of rows of tiles that are sent and composited as they are made. Fast before
// small: numbers are packed to bits, only coverage, block ids and palettes are compressed. The byte
// layout is in docs/format/wire.md.

#ifndef ISOSCOPE_CORE_COMPOSITE_PIXEL_CODEC_H_
#define ISOSCOPE_CORE_COMPOSITE_PIXEL_CODEC_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

#include "core/image/frame_image.h"

namespace isoscope::composite {

// Encodes the pixels of `image` that are not background, as bands of whole rows of tiles: at most
// kMaxBandRows pixels high and kMaxBandBytes long. No such pixel: no band. In parallel, inside the
// caller's TBB arena. O(pixels of touched tiles). Thread-safe.
std::vector<std::string> EncodePixels(const image::FrameImage& image);
inline constexpr std::int64_t kMaxBandBytes = std::int64_t{4} << 20;
inline constexpr int kMaxBandRows = 128;

// Composites the pixels of one band into `into` (CompositeInto's rule) and inserts their tiles into
// `into->touched`. DATA_LOSS if the bytes are damaged or don't fit the image; then `into` is
// unchanged. Thread-compatible; but bands of EncodePixels(one image) cover different rows of tiles,
// and threads may composite such bands into one image at the same time.
absl::Status DecodePixelsInto(absl::string_view band, image::FrameImage* into);

}  // namespace isoscope::composite

#endif  // ISOSCOPE_CORE_COMPOSITE_PIXEL_CODEC_H_
