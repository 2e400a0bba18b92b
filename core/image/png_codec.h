// PNG files in memory, 8-bit sRGB: png_encoder.cc, with ISA-L's deflate; png_decoder.cc, by libpng.

#ifndef ISOSCOPE_CORE_IMAGE_PNG_CODEC_H_
#define ISOSCOPE_CORE_IMAGE_PNG_CODEC_H_

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/image/frame_image.h"
#include "core/image/png_filter.h"

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
// ISA-L 2.30 finds other matches). REQUIRES: 1 <= width < 2^28, height >= 1. Throws std::bad_alloc
// if memory runs out. Thread-safe.
std::string EncodePng(int width, int height, std::span<const Rgba8> pixels,
                      const std::optional<Rgba8>& background = std::nullopt);

// Encodes an image that is in memory a few rows at a time. The caller writes the bytes that the
// calls return, one after another: Begin, then Append until all rows are there, then End. Works in
// parallel, in the tbb::task_arena of the caller. Throws std::bad_alloc if memory runs out.
// Thread-compatible.
class PngRowWriter {
 public:
  // RGB if `is_opaque`, which leaves alpha out, else RGBA. REQUIRES: width and height as EncodePng.
  PngRowWriter(int width, int height, bool is_opaque)
      : width_(width), height_(height), is_opaque_(is_opaque) {}

  // The number of rows that are compressed together. Rows appended in multiples of it give the
  // bytes of EncodePng.
  static int RowsPerStripe(int width);

  [[nodiscard]] std::string Begin() const;
  // Takes the next rows. REQUIRES: they are whole, and not more than are missing.
  std::string Append(std::span<const Rgba8> rows);
  // REQUIRES: all rows were appended.
  [[nodiscard]] std::string End() const;

 private:
  [[nodiscard]] PngChannels Channels() const {
    return is_opaque_ ? PngChannels::kRgb : PngChannels::kRgba;
  }

  const int width_;
  const int height_;
  const bool is_opaque_;
  int row_count_ = 0;            // appended
  std::vector<Rgba8> last_row_;  // empty before the first
  std::uint32_t adler_ = 1;      // of all filtered bytes
};

// The largest width and height that DecodePng accepts.
inline constexpr int kMaxPngSidePx = 16384;

// Decodes a PNG to RGBA: grey, palettes and transparent colours are expanded, 16 bits scaled to 8.
// Bytes after the end of the PNG are ignored. Safe for any bytes: an image whose pixels can't fit
// in the bytes given is refused before memory is allocated for it. DATA_LOSS if the bytes are no
// complete, undamaged PNG. Thread-safe.
absl::StatusOr<RgbaImage> DecodePng(absl::string_view png);

}  // namespace isoscope::image

#endif  // ISOSCOPE_CORE_IMAGE_PNG_CODEC_H_
