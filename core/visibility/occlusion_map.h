// The occlusion map: the coordinator makes it between steps 2 and 3 of a frame, from the composited
// occluders, and tests blocks, and pixels of blocks, against it.
//
// It is conservative by construction: a texel holds the FARTHEST depth of its pixels, and a block
// is hidden only if its nearest depth is strictly greater than every texel of its footprint. So no
// hidden block could have won a pixel (docs/numerics.md, "Depth, fragments and exact culling").

#ifndef ISOSCOPE_CORE_VISIBILITY_OCCLUSION_MAP_H_
#define ISOSCOPE_CORE_VISIBILITY_OCCLUSION_MAP_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/image/frame_image.h"
#include "core/image/pixel_mask.h"
#include "core/view/view.h"

namespace isoscope::visibility {

enum class MapKind {
  kDepth,  // farthest depth: exact culling
  kMask,   // covered or not: the paper's 1-bit mask, approximate
};

// A mask made by ClosedMaskOf has at most this many columns, and as many rows.
inline constexpr int kMaxMaskSide = 32;

// Returns the mask of a rectangle with no cell open. Its cells are those that touch the rectangle,
// with the smallest shift for which there are at most kMaxMaskSide columns and rows; an empty
// rectangle has none. The shape depends on the rectangle alone: a receiver that knows the rectangle
// needs only the bits. REQUIRES: 0 <= begin_x, begin_y.
image::PixelMask ClosedMaskOf(const view::PixelRect& rect);

// Depths of an image, one texel a pixel, row 0 at the top, and a pyramid of farthest depths above
// it. Immutable after construction; thread-safe. Memory: 5.3 bytes for each pixel of a touched
// tile.
class OcclusionMap {
 public:
  // Makes a map that covers nothing and hides no block: for CULLING_NONE.
  OcclusionMap() = default;
  OcclusionMap(OcclusionMap&&) = default;
  OcclusionMap& operator=(OcclusionMap&&) = default;

  // Builds the map of a composited image, in parallel in the caller's TBB arena.
  // O(pixels of touched tiles).
  // REQUIRES: the image is not empty.
  static OcclusionMap FromImage(const image::FrameImage& image, MapKind kind);

  // Returns true if no fragment of a block with this footprint can win a pixel over the map's image
  // (kDepth), or if all its pixels are covered (kMask). The answer equals a test of each pixel of
  // the rectangle; the pyramid gives it from a few texels. Every map but the default one hides an
  // empty rectangle. REQUIRES: the rectangle lies inside the image.
  [[nodiscard]] bool Hides(const view::Footprint& footprint) const;

  // Returns the pixels at which a fragment of a block with this footprint could still win (kDepth),
  // or that are not covered (kMask), rounded outward to the cells of ClosedMaskOf(footprint.rect):
  // a cell is closed only if Hides would be true of a footprint that is the whole cell. A mask
  // without an open cell means hidden. The reverse need not hold where cells are larger than a
  // pixel. The default map leaves every cell open. REQUIRES: the rectangle lies inside the image.
  [[nodiscard]] image::PixelMask OpenPixels(const view::Footprint& footprint) const;

 private:
  // Mip levels 0 to 3 of the pyramid are kept tile by tile, so that all tiles without a fragment
  // share one; level 4, with one texel a tile, and coarser ones are kept as planes.
  static constexpr int kTileMipLevels = 4;
  static_assert(image::TileSet::kTilePx == 1 << kTileMipLevels);
  // Offset of levels 0 to 3 in the texels of a tile, and the count of all.
  static constexpr std::array<std::size_t, kTileMipLevels + 1> kMipLevelOffset{0, 256, 320, 336,
                                                                               340};
  static constexpr std::size_t kTileTexels = kMipLevelOffset[kTileMipLevels];
  // The texel of an uncovered pixel: farther than every depth.
  static constexpr float kUncovered = 2.0F;

  struct Plane {
    int width = 0;
    int height = 0;
    std::vector<float> texels;
  };

  void BuildTiles(const image::FrameImage& image);
  void BuildPlanes();
  // Returns the limit: a texel hides the footprint's block if it is nearer than this depth.
  [[nodiscard]] float LimitOf(const view::Footprint& footprint) const {
    return kind_ == MapKind::kMask ? kUncovered : footprint.nearest_depth;
  }
  [[nodiscard]] int mip_level_count() const {
    return kTileMipLevels + static_cast<int>(planes_.size());
  }
  // Returns texel (x, y) of a level: the farthest depth of its pixels.
  [[nodiscard]] float TexelAt(int mip_level, int x, int y) const;
  // Returns one bit a texel of [begin_x, end_x), lowest first: set if texel (x, y) of a level is
  // not nearer than `limit`. REQUIRES: at most 32 texels.
  [[nodiscard]] std::uint32_t OpenTexels(int mip_level, int y, int begin_x, int end_x,
                                         float limit) const;
  // Returns true if all pixels of `rect` in texel (x, y) of `mip_level` are nearer than `limit`.
  [[nodiscard]] bool IsNearer(int mip_level, int x, int y, const view::PixelRect& rect,
                              float limit) const;

  MapKind kind_ = MapKind::kDepth;
  int width_px_ = 0;
  int height_px_ = 0;
  // By tile, row by row: where its texels begin in tiles_, in units of kTileTexels. All tiles
  // without a fragment have 0, where every texel is uncovered.
  std::vector<std::uint32_t> stored_index_;
  std::unique_ptr<float[]> tiles_;
  // Level 4 and up. Each next plane halves both sides; the last is 1 x 1.
  std::vector<Plane> planes_;
};

}  // namespace isoscope::visibility

#endif  // ISOSCOPE_CORE_VISIBILITY_OCCLUSION_MAP_H_
