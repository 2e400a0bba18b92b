// Encode, for one image:
//
//   1. FindCovered lists the covered tiles of each row, and counts their pixels, rows in parallel.
//   2. CutIntoBands joins rows to bands. A band ends when it has enough pixels, or when the next
//      row could exceed kMaxBandBytes in the worst case.
//   3. EncodeBand (band_encoder.h) makes the bytes, bands in parallel.
//
// DecodePixelsInto, for one band:
//
//   1. DecodeBand (band_decoder.h) checks and decodes all of it before a pixel is composited.
//   2. Row of tiles by row of tiles, with the row's lock, CompositeTile or InsertTile takes the
//      tile's keys and colours, which lie one behind the other in the band.

#include "core/composite/pixel_codec.h"

#include <algorithm>
#include <bit>
#include <iterator>
#include <span>
#include <utility>

#include <oneapi/tbb/parallel_for.h>

#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/composite/band_decoder.h"
#include "core/composite/band_encoder.h"
#include "core/composite/band_format.h"
#include "core/composite/tile_packing.h"
#include "core/composite/tile_prediction.h"

namespace isoscope::composite {
namespace {

// The most bytes that a tile takes besides its pixels: coverage and dictionary size.
constexpr std::size_t kMaxTileOverhead = 2 * kTilePx + 1;
// The most bytes that a pixel takes, if each has an owner of its own: owner, label, control byte,
// extra bits of depth and colour.
constexpr std::size_t kMaxPixelBytes = 4 + 1 + 1 + 4 + 4;
// Room for header, palette, and the bytes that Zstandard adds where it can't compress.
constexpr std::size_t kMaxFixedBytes = std::size_t{1} << 15;
// The columns of the widest image. One of its rows of tiles must fit into a band.
constexpr std::size_t kMaxColumns = 16384 / kTilePx;
static_assert((kMaxTileOverhead + kTilePixels * kMaxPixelBytes) * kMaxColumns + kMaxColumns / 8 +
                  kMaxFixedBytes <
              kMaxBandBytes);
// Fewer pixels are not worth a band of their own. More bands do not keep more cores busy.
constexpr std::size_t kMinBandPixels = std::size_t{1} << 14;
constexpr std::size_t kBandsWanted = 16;

TileRow FindCovered(const image::FrameImage& image, int tile_y) {
  TileRow row;
  image.touched.ForEachInRow(tile_y, [&](int tile_x) {
    const TileMask& mask = image.CoveredOf(tile_x, tile_y);
    if (mask != TileMask{}) {
      row.areas.push_back(AreaOf(tile_x, tile_y, image));
      row.masks.push_back(mask);
      row.pixel_count += PixelCount(mask);
    }
  });
  return row;
}

// Cuts the rows of an image into bands. An image without covered pixels has none. It makes few
// bands, because each has a header, a palette and a Zstandard frame.
std::vector<BandRows> CutIntoBands(const std::vector<TileRow>& rows, std::size_t row_bytes) {
  std::size_t pixels_in_all = 0;
  for (const TileRow& row : rows) {
    pixels_in_all += row.pixel_count;
  }
  const std::size_t pixels_wanted = std::max(kMinBandPixels, pixels_in_all / kBandsWanted);
  std::vector<BandRows> bands;
  std::size_t pixels = 0;
  std::size_t bytes = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].pixel_count == 0) {
      continue;
    }
    const int row = static_cast<int>(i);
    const std::size_t more =
        rows[i].areas.size() * kMaxTileOverhead + rows[i].pixel_count * kMaxPixelBytes;
    const auto gap = bands.empty() ? 0 : static_cast<std::size_t>(row - bands.back().end);
    if (bands.empty() || pixels >= pixels_wanted ||
        bytes + more + (gap + 1) * row_bytes > static_cast<std::size_t>(kMaxBandBytes)) {
      bands.push_back({row, row});
      pixels = 0;
      bytes = kMaxFixedBytes;
    } else {
      bytes += gap * row_bytes;
    }
    bands.back().end = row + 1;
    pixels += rows[i].pixel_count;
    bytes += more + row_bytes;
  }
  return bands;
}

// Composites the covered pixels of one tile.
void CompositeTile(const TileArea& area, const TileMask& mask, const std::uint64_t* key,
                   const image::Rgba8* color, const image::FragmentOrder& order,
                   image::FrameImage* into) {
  const int tile_column = area.x / kTilePx;
  const int tile_row = area.y / kTilePx;
  into->touched.Insert(tile_column, tile_row);
  image::UniteInto(mask, &into->CoveredOf(tile_column, tile_row));
  const std::size_t first = into->IndexOf(area.x, area.y);
  const auto stride = static_cast<std::size_t>(into->width);
  std::uint64_t* const into_keys = into->keys.data() + first;
  image::Rgba8* const into_colors = into->colors.data() + first;
  if (UnpackNearer(mask, key, color, stride, into_keys, into_colors)) [[unlikely]] {
    SettleTies(mask, key, color, stride, order, into_keys, into_colors);
  }
}

// Inserts the covered pixels of one tile of a layer image.
void InsertTile(const TileArea& area, const TileMask& mask, const std::uint64_t* key,
                const image::Rgba8* color, image::LayerStack* layers) {
  for (std::size_t row = 0; row < mask.size(); ++row) {
    for (std::uint32_t rest = mask[row]; rest != 0; rest &= rest - 1) {
      layers->Insert(area.x + std::countr_zero(rest), area.y + static_cast<int>(row), *key++,
                     *color++);
    }
  }
}

std::vector<std::string> Encode(const image::FrameImage& image, bool is_layer) {
  std::vector<TileRow> rows(static_cast<std::size_t>(image.touched.rows()));
  tbb::parallel_for(std::size_t{0}, rows.size(), [&](std::size_t row) {
    rows[row] = FindCovered(image, static_cast<int>(row));
  });
  const std::vector<BandRows> cuts = CutIntoBands(rows, 8 * RowWords(image.touched));
  std::vector<std::string> bands(cuts.size());
  tbb::parallel_for(std::size_t{0}, bands.size(), [&](std::size_t i) {
    const auto begin = static_cast<std::size_t>(cuts[i].begin);
    const auto count = static_cast<std::size_t>(cuts[i].end - cuts[i].begin);
    bands[i] = EncodeBand(image, cuts[i], std::span(rows).subspan(begin, count), is_layer);
  });
  return bands;
}

}  // namespace

std::vector<std::string> EncodePixels(const image::FrameImage& image) {
  return Encode(image, /*is_layer=*/false);
}

std::vector<std::string> EncodeLayers(const image::LayerStack& layers) {
  std::vector<std::string> bands;
  for (const image::FrameImage* layer_image : layers.LayerImages()) {
    std::vector<std::string> image_bands = Encode(*layer_image, /*is_layer=*/true);
    std::move(image_bands.begin(), image_bands.end(), std::back_inserter(bands));
  }
  return bands;
}

RowLocks::RowLocks(int height_px)
    : mutexes_(std::make_unique<base::Mutex[]>(
          static_cast<std::size_t>((height_px + kTilePx - 1) / kTilePx))) {}

absl::Status DecodePixelsInto(absl::string_view band, const image::FragmentOrder& order,
                              const SurfaceCounts& surfaces, image::FrameImage* into,
                              RowLocks* locks, image::LayerStack* layers) {
  ISOSCOPE_ASSIGN_OR_RETURN(const BandPixels pixels, DecodeBand(band, *into, order, surfaces));
  if (pixels.is_layer && layers == nullptr) {
    return absl::DataLossError("pixel band of translucent layers in a frame that has none");
  }
  const std::uint64_t* key = pixels.keys.get();
  const image::Rgba8* color = pixels.colors.get();
  for (std::size_t tile = 0; tile < pixels.areas.size();) {
    const int tile_row = pixels.areas[tile].y / kTilePx;
    const base::MutexLockMaybe lock(locks == nullptr ? nullptr : &locks->OfTileRow(tile_row));
    for (; tile < pixels.areas.size() && pixels.areas[tile].y / kTilePx == tile_row; ++tile) {
      if (const std::size_t later = tile + kPrefetchTiles; later < pixels.areas.size()) {
        PrefetchRows(into->keys, pixels.areas[later], pixels.masks[later], into->width);
        PrefetchRows(into->colors, pixels.areas[later], pixels.masks[later], into->width);
      }
      const std::size_t count = PixelCount(pixels.masks[tile]);
      if (pixels.is_layer) {
        InsertTile(pixels.areas[tile], pixels.masks[tile], key, color, layers);
      } else {
        CompositeTile(pixels.areas[tile], pixels.masks[tile], key, color, order, into);
      }
      key += count;
      color += count;
    }
  }
  return absl::OkStatus();
}

}  // namespace isoscope::composite
