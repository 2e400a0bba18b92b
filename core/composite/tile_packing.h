// The covered pixels of a tile one after the other, out of the rows of an image and back: in vector
// lanes, where the processor can pack them.

#ifndef ISOSCOPE_CORE_COMPOSITE_TILE_PACKING_H_
#define ISOSCOPE_CORE_COMPOSITE_TILE_PACKING_H_

#include <cstddef>
#include <cstdint>

#include "core/composite/tile_prediction.h"
#include "core/image/frame_image.h"

namespace isoscope::composite {

// What PackKeys and PackColors may write past the last pixel.
inline constexpr std::size_t kPackPadding = kTilePx - 1;

// The bits of the depths, and the owners, of the tile whose first key is keys[0], rows `stride`
// apart. Only keys of covered pixels are read. The same on every instruction set.
// REQUIRES: room for PixelCount(mask) + kPackPadding numbers each.
void PackKeys(const TileMask& mask, const std::uint64_t* keys, std::size_t stride,
              std::uint32_t* depths, std::uint32_t* owners);

// The same of colours, as image::PackedColor(color) of band_format.h.
void PackColors(const TileMask& mask, const image::Rgba8* colors, std::size_t stride,
                std::uint32_t* numbers);

// The other way, with a depth test: puts pixels into the tile whose first ones are into_keys[0] and
// into_colors[0], where their depth is the smaller one. Returns true if a pixel has the depth of
// the one that is there but another owner: such ties are left for SettleTies.
bool UnpackNearer(const TileMask& mask, const std::uint64_t* keys, const image::Rgba8* colors,
                  std::size_t stride, std::uint64_t* into_keys, image::Rgba8* into_colors);

// Decides the ties that UnpackNearer left: the fragment that comes first in `order` stays.
void SettleTies(const TileMask& mask, const std::uint64_t* keys, const image::Rgba8* colors,
                std::size_t stride, const image::FragmentOrder& order, std::uint64_t* into_keys,
                image::Rgba8* into_colors);

}  // namespace isoscope::composite

#endif  // ISOSCOPE_CORE_COMPOSITE_TILE_PACKING_H_
