// JPEG files in memory, 8-bit sRGB, written and read with libjpeg-turbo.

#ifndef ISOSCOPE_CORE_IMAGE_JPEG_CODEC_H_
#define ISOSCOPE_CORE_IMAGE_JPEG_CODEC_H_

#include <memory>
#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/image/fragment.h"
#include "core/image/png_codec.h"

namespace isoscope::image {

// Encodes an image without subsampling of colours (4:4:4).
//
// pixels:     width * height, row 0 at the top
// background: shown in place of pixels whose alpha is 0; alpha is ignored otherwise
// quality:    1 to 100
//
// The same pixels give the same bytes with the same libjpeg-turbo. REQUIRES: 1 <= width, height <=
// 65500. RESOURCE_EXHAUSTED when memory runs out. Thread-safe.
absl::StatusOr<std::string> EncodeJpeg(int width, int height, std::span<const Rgba8> pixels,
                                       Rgba8 background, int quality);

// Encodes an image that is in memory a few rows at a time. The bytes that the calls return, one
// after another, are those of EncodeJpeg. May throw std::bad_alloc. Thread-compatible.
class JpegRowWriter {
 public:
  // Parameters as of EncodeJpeg, and the same REQUIRES.
  JpegRowWriter(int width, int height, Rgba8 background, int quality);
  JpegRowWriter(JpegRowWriter&& other) noexcept;
  JpegRowWriter& operator=(JpegRowWriter&& other) noexcept;
  ~JpegRowWriter();

  // Takes the next rows, and returns the bytes that are complete: none for a few rows, all that is
  // left for the last ones. REQUIRES: the rows are whole, and not more than are missing.
  // RESOURCE_EXHAUSTED when memory runs out; so do all later calls.
  absl::StatusOr<std::string> Append(std::span<const Rgba8> rows);

 private:
  struct State;

  std::unique_ptr<State> state_;
};

// Decodes a JPEG of grey or colours to opaque pixels. Safe for any bytes. DATA_LOSS if they are no
// complete JPEG, or one with a side above kMaxPngSidePx. Thread-safe.
absl::StatusOr<RgbaImage> DecodeJpeg(absl::string_view jpeg);

}  // namespace isoscope::image

#endif  // ISOSCOPE_CORE_IMAGE_JPEG_CODEC_H_
