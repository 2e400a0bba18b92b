// Moves the covered pixels of a tile from the rows of an image to a dense list, and back.

#ifndef ISOSCOPE_CORE_COMPOSITE_TILE_PACKING_H_
#define ISOSCOPE_CORE_COMPOSITE_TILE_PACKING_H_

#include <cstddef>
#include <cstdint>

#include "core/composite/tile_prediction.h"
#include "core/image/frame_image.h"

namespace isoscope::composite {

// PackKeys and PackColors may write this many elements past the last pixel.
inline constexpr std::size_t kPackPadding = kTilePx - 1;

// Packs the keys of the covered pixels of a tile: the bits of their depths, and their owners. The
// same on every instruction set. Thread-safe; so are the functions below.
//
// mask:           the covered pixels; no other key is read
// keys:           the tile's first key; rows are `stride` keys apart
// depths, owners: capacity PixelCount(mask) + kPackPadding each
void PackKeys(const TileMask& mask, const std::uint64_t* keys, std::size_t stride,
              std::uint32_t* depths, std::uint32_t* owners);

// Packs the colours of the covered pixels, as image::PackedColor; else the same.
void PackColors(const TileMask& mask, const image::Rgba8* colors, std::size_t stride,
                std::uint32_t* numbers);

// Unpacks pixels into a tile with a depth test: each replaces the tile's pixel if its depth is
// smaller. Returns true if a pixel has the depth of the tile's: such ties are left for SettleTies.
//
// keys, colors:           PixelCount(mask) elements, in the order of the mask
// into_keys, into_colors: the tile's first pixel; rows are `stride` elements apart
bool UnpackNearer(const TileMask& mask, const std::uint64_t* keys, const image::Rgba8* colors,
                  std::size_t stride, std::uint64_t* into_keys, image::Rgba8* into_colors);

// Decides the ties that UnpackNearer left: the fragment that comes first in `order` stays.
void SettleTies(const TileMask& mask, const std::uint64_t* keys, const image::Rgba8* colors,
                std::size_t stride, const image::FragmentOrder& order, std::uint64_t* into_keys,
                image::Rgba8* into_colors);

}  // namespace isoscope::composite

#endif  // ISOSCOPE_CORE_COMPOSITE_TILE_PACKING_H_
