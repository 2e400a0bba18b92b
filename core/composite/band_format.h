// The format of a band of pixels: the parts that encoder and decoder share. docs/format/wire.md has
// the layout.

#ifndef ISOSCOPE_CORE_COMPOSITE_BAND_FORMAT_H_
#define ISOSCOPE_CORE_COMPOSITE_BAND_FORMAT_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/base/large_pages.h"
#include "core/composite/tile_prediction.h"
#include "core/image/frame_image.h"
#include "core/image/tile_set.h"

namespace isoscope::composite {

// The padding behind the extra bits, so that reading 8 bytes at once never leaves the band.
inline constexpr std::size_t kBandPaddingBytes = 8;
// A band with more colours sends each as it is.
inline constexpr std::size_t kMaxPaletteSize = 2048;

struct BandHeader {
  bool is_layer = false;  // pixels of an image::LayerStack, in place of opaque ones
  int begin_row = 0;      // of tiles
  int row_count = 0;
  std::size_t pixel_count = 0;
  std::size_t tile_count = 0;
  std::size_t dictionary_count = 0;
  std::size_t label_count = 0;
  std::size_t palette_size = 0;  // 0: colours are sent as they are
  std::size_t frame_size = 0;    // bytes of the compressed side information
  std::size_t extras_size = 0;   // bytes of the extra bits, with padding
};
inline constexpr std::size_t kBandHeaderSize = 56;

// The header of a band of an image of `width` x `height` pixels. SealBand writes its checksum.
std::string MakeBandHeader(const BandHeader& header, int width, int height);

// Writes the checksum of a complete band into its header.
void SealBand(std::string* band);

// Reads the header. DATA_LOSS unless checksum and size are right, the band fits `image`, and its
// counts are possible. The decoder finds out whether the counts are true.
absl::StatusOr<BandHeader> ReadBandHeader(absl::string_view band, const image::FrameImage& image);

// The side information: all of a band but the header, control bytes and extra bits.
struct BandSideInfo {
  std::vector<std::uint64_t> present;  // a bit a tile; a row of tiles begins at a word
  std::vector<TileMask> masks;         // of tiles with a covered pixel
  std::vector<std::uint8_t> dictionary_sizes;
  std::vector<std::uint32_t> dictionaries;  // owners
  std::vector<std::uint8_t> labels;
};

// The numbers of surfaces and blocks that the owners of a frame's fragments name
// (image::FragmentOrder). A decoded owner lies within them, so lookups by owner need no further
// check.
struct SurfaceCounts {
  std::size_t opaque = 0;
  std::size_t layers = 0;
};

// Words of BandSideInfo::present for a row of tiles.
inline std::size_t RowWords(const image::TileSet& tiles) {
  return static_cast<std::size_t>((tiles.columns() + 63) / 64);
}

// The part of a tile that lies inside the image, in pixels.
struct TileArea {
  int x;
  int y;
  int columns;
  int rows;
};
inline TileArea AreaOf(int tile_x, int tile_y, const image::FrameImage& image) {
  const int x = tile_x * kTilePx;
  const int y = tile_y * kTilePx;
  return {x, y, std::min(kTilePx, image.width - x), std::min(kTilePx, image.height - y)};
}

// PrefetchRows asks for a tile this many tiles ahead. Images have left the processor's cache when
// they are encoded or decoded into, and their rows are too far apart for the processor to guess.
inline constexpr std::size_t kPrefetchTiles = 2;

// Prefetches the rows of a tile that have a pixel in `mask`. Rows of `plane` have `width` elements.
template <typename T>
void PrefetchRows(const base::LargePageVector<T>& plane, const TileArea& area, const TileMask& mask,
                  int width) {
  constexpr std::size_t kLine = 64;
  const T* row = plane.data() + static_cast<std::size_t>(area.y) * static_cast<std::size_t>(width) +
                 static_cast<std::size_t>(area.x);
  for (const std::uint16_t row_mask : mask) {
    if (row_mask != 0) {
      const char* const bytes = reinterpret_cast<const char*>(row);
      for (std::size_t at = 0; at < kTilePx * sizeof(T); at += kLine) {
        __builtin_prefetch(bytes + at);
      }
    }
    row += width;
  }
}

// Unpacks a colour that image::PackedColor packed.
constexpr image::Rgba8 ColorOf(std::uint32_t packed) {
  return {static_cast<std::uint8_t>(packed >> 24), static_cast<std::uint8_t>(packed >> 16),
          static_cast<std::uint8_t>(packed >> 8), static_cast<std::uint8_t>(packed)};
}

// Appends owners or a palette: the difference of each number to the one before, as 4 planes of
// bytes, the lowest bytes first.
void AppendNumbers(const std::vector<std::uint32_t>& numbers, std::string* out);
// Reads what AppendNumbers appended. REQUIRES: planes.size() == 4 * count.
std::vector<std::uint32_t> ReadNumbers(absl::string_view planes, std::size_t count);

}  // namespace isoscope::composite

#endif  // ISOSCOPE_CORE_COMPOSITE_BAND_FORMAT_H_
