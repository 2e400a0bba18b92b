// PNG files in memory, by libpng: 8-bit RGBA, sRGB. The same pixels give the same bytes.

#ifndef ISOSCOPE_CORE_IMAGE_PNG_CODEC_H_
#define ISOSCOPE_CORE_IMAGE_PNG_CODEC_H_

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

// Encodes `pixels`, width * height of them; opaque images are written as RGB.
// REQUIRES: width, height >= 1. Thread-safe.
std::string EncodePng(int width, int height, const std::vector<Rgba8>& pixels);

// Decodes any 8-bit PNG to RGBA. DATA_LOSS if the bytes are no complete PNG. Thread-safe.
absl::StatusOr<RgbaImage> DecodePng(absl::string_view png);

}  // namespace isoscope::image

#endif  // ISOSCOPE_CORE_IMAGE_PNG_CODEC_H_
