// PNG files in memory, 8-bit sRGB: written with ISA-L's deflate, read with libpng.

#ifndef ISOSCOPE_CORE_IMAGE_PNG_CODEC_H_
#define ISOSCOPE_CORE_IMAGE_PNG_CODEC_H_

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/image/frame_image.h"

namespace isoscope::image {

struct RgbaImage {
  int width = 0;
  int height = 0;
  std::vector<Rgba8> pixels;  // width * height, row 0 at the top

  friend bool operator==(const RgbaImage&, const RgbaImage&) = default;
};

// Encodes an image: as RGB if all its pixels are opaque, else as RGBA.
//
// pixels:     width * height, row 0 at the top
// background: if given, shown in place of pixels whose alpha is 0
//
// Works in parallel, in the tbb::task_arena of the caller. The same pixels give the same bytes for
// any number of threads (checked on x86-64 from SSE4.2 to AVX-512; on processors without SSE4.2,
// ISA-L 2.30 finds other matches). REQUIRES: 1 <= width < 2^28, height >= 1. Aborts when memory
// runs out. Thread-safe.
std::string EncodePng(int width, int height, std::span<const Rgba8> pixels,
                      const std::optional<Rgba8>& background = std::nullopt);

// The largest width and height that DecodePng accepts.
inline constexpr int kMaxPngSidePx = 16384;

// Decodes a PNG to RGBA: grey, palettes and transparent colours are expanded, 16 bits scaled to 8.
// Bytes after the end of the PNG are ignored. Safe for any bytes: an image whose pixels can't fit
// in the bytes given is refused before memory is allocated for it. DATA_LOSS if the bytes are no
// complete, undamaged PNG. Thread-safe.
absl::StatusOr<RgbaImage> DecodePng(absl::string_view png);

}  // namespace isoscope::image

#endif  // ISOSCOPE_CORE_IMAGE_PNG_CODEC_H_
