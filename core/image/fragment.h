// A pixel shows the fragment that comes first in one total order (docs/numerics.md, "Depth,
// fragments and exact culling").
//
// A fragment is what one triangle contributes to one pixel: a depth, a colour, and its owner, the
// surface and the block that the triangle belongs to. Depth and owner travel as one 64-bit key:
//
//   63          32 31                                0
//   | depth bits  | surface_index * block_count + id |
//
// Depths are in [0, 1], where IEEE bits order as the values do, so that unequal depths are decided
// by one comparison of keys. Equal depths are rare; FragmentOrder::IsBefore decides them.

#ifndef ISOSCOPE_CORE_IMAGE_FRAGMENT_H_
#define ISOSCOPE_CORE_IMAGE_FRAGMENT_H_

#include <bit>
#include <cstdint>
#include <limits>

namespace isoscope::image {

// 8-bit sRGB with straight alpha.
struct Rgba8 {
  std::uint8_t r = 0;
  std::uint8_t g = 0;
  std::uint8_t b = 0;
  std::uint8_t a = 0;

  friend constexpr bool operator==(const Rgba8&, const Rgba8&) = default;
};

// A colour as one integer, red in the highest byte: colours are ordered by it.
constexpr std::uint32_t PackedColor(Rgba8 color) {
  return std::uint32_t{color.r} << 24 | std::uint32_t{color.g} << 16 | std::uint32_t{color.b} << 8 |
         color.a;
}

// The owner of a background pixel.
inline constexpr std::uint32_t kNoOwner = std::numeric_limits<std::uint32_t>::max();
// The depth of a background pixel.
inline constexpr float kFarDepth = 1.0F;

// REQUIRES: 0 <= depth <= 1.
constexpr std::uint64_t FragmentKey(float depth, std::uint32_t owner) {
  // + 0.0F turns -0 into +0, whose bits are the smallest.
  return std::uint64_t{std::bit_cast<std::uint32_t>(depth + 0.0F)} << 32 | owner;
}
inline constexpr std::uint64_t kBackgroundKey = FragmentKey(kFarDepth, kNoOwner);

constexpr float DepthOf(std::uint64_t key) {
  return std::bit_cast<float>(static_cast<std::uint32_t>(key >> 32));
}
constexpr std::uint32_t OwnerOf(std::uint64_t key) { return static_cast<std::uint32_t>(key); }
constexpr bool HaveEqualDepth(std::uint64_t a, std::uint64_t b) { return (a ^ b) >> 32 == 0; }

// Decides between fragments of equal depth.
enum class TieRule {
  // Surface, colour, owner. Fragments that are equal in depth, surface and colour can't be told
  // apart in the picture, so neither blocks nor agents can show.
  kColor,
  // Surface, block, colour. Pictures then depend on how the volume is cut.
  kOwner,
};

// The order of the fragments of one frame. The background comes last, because its owner is above
// every other one: REQUIRES surfaces * block_count <= kNoOwner.
struct FragmentOrder {
  std::uint32_t block_count = 1;  // of the volume
  TieRule ties = TieRule::kColor;

  [[nodiscard]] constexpr std::uint32_t OwnerOf(std::uint32_t surface_index,
                                                std::uint32_t block_id) const {
    return surface_index * block_count + block_id;
  }
  [[nodiscard]] constexpr std::uint32_t SurfaceOf(std::uint32_t owner) const {
    return owner / block_count;
  }

  // Whether fragment `a` comes before fragment `b`. False for equal ones.
  [[nodiscard]] constexpr bool IsBefore(std::uint64_t a, Rgba8 a_color, std::uint64_t b,
                                        Rgba8 b_color) const {
    if (!HaveEqualDepth(a, b) || (ties == TieRule::kOwner && a != b)) {
      return a < b;
    }
    const std::uint32_t a_surface = SurfaceOf(image::OwnerOf(a));
    const std::uint32_t b_surface = SurfaceOf(image::OwnerOf(b));
    if (a_surface != b_surface) {
      return a_surface < b_surface;
    }
    if (a_color != b_color) {
      return PackedColor(a_color) < PackedColor(b_color);
    }
    return a < b;
  }

  // Compositing of two fragments of one pixel: the first of them is kept in `into`.
  constexpr void KeepFirst(std::uint64_t from, Rgba8 from_color, std::uint64_t* into,
                           Rgba8* into_color) const {
    if (IsBefore(from, from_color, *into, *into_color)) {
      *into = from;
      *into_color = from_color;
    }
  }
};

}  // namespace isoscope::image

#endif  // ISOSCOPE_CORE_IMAGE_FRAGMENT_H_
