// Between steps 2 and 3 of a frame: the occlusion map, made by the coordinator from the composited
// occluders, and the tests by which it culls blocks, and pixels of blocks, against it.
//
// Conservative by construction: a texel holds the FARTHEST depth of its pixels, and a block is
// hidden only if its nearest depth is strictly larger than every texel of its footprint. So no
// hidden block could have won a pixel (docs/numerics.md has the proof).

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

// The longer side of a mask made by ClosedMaskOf is at most so many cells.
inline constexpr int kMaxMaskSide = 32;

// The mask of a rectangle with no cell open: the smallest shift for which it has at most
// kMaxMaskSide columns and rows, and the cells that touch the rectangle; an empty rectangle has no
// cells. A function of the rectangle alone, so that who knows the rectangle needs only the bits.
// REQUIRES: 0 <= begin_x, begin_y.
image::PixelMask ClosedMaskOf(const view::PixelRect& rect);

// Row 0 is the top. Immutable after construction; thread-safe. Memory: 5.3 bytes for each pixel of
// a touched tile.
class OcclusionMap {
 public:
  // Covers nothing: hides no block (an occlusion map for CULLING_NONE).
  OcclusionMap() = default;
  OcclusionMap(OcclusionMap&&) = default;
  OcclusionMap& operator=(OcclusionMap&&) = default;

  // Builds the map of a composited image, one texel a pixel, and the pyramid of farthest depths
  // above it; in parallel, inside the caller's TBB arena. O(pixels of touched tiles).
  // REQUIRES: the image is not empty.
  static OcclusionMap FromImage(const image::FrameImage& image, MapKind kind);

  // True if no fragment of a block with this footprint can win a pixel over what the map was built
  // from (kDepth), or if all its pixels are covered (kMask). The answer is that of all pixels of
  // the rectangle; the pyramid finds it by looking at few. An empty rectangle is hidden by every
  // map but the default one. REQUIRES: the rectangle lies inside the image.
  [[nodiscard]] bool Hides(const view::Footprint& footprint) const;

  // The pixels at which a fragment of a block with this footprint could still win (kDepth), or that
  // are not covered (kMask), rounded outward to the cells of ClosedMaskOf(footprint.rect): a cell
  // is closed only if Hides would be true of a footprint that is the whole cell. No bit set means
  // hidden; the opposite need not hold where cells are larger than a pixel. The default map leaves
  // every cell open. REQUIRES: the rectangle lies inside the image.
  [[nodiscard]] image::PixelMask OpenPixels(const view::Footprint& footprint) const;

 private:
  // Levels of the pyramid up to a whole tile are kept by tile, so that tiles that nothing is drawn
  // on share one; level 4, one texel a tile, and coarser ones are kept as planes.
  static constexpr int kTileLevels = 4;
  static_assert(image::TileSet::kTilePx == 1 << kTileLevels);
  // Texels of one tile before those of level 0 .. 3.
  static constexpr std::array<std::size_t, kTileLevels + 1> kLevelOffset{0, 256, 320, 336, 340};
  static constexpr std::size_t kTileTexels = kLevelOffset[kTileLevels];
  // Farther than every depth: a pixel that nothing is drawn on.
  static constexpr float kUncovered = 2.0F;

  struct Plane {
    int width = 0;
    int height = 0;
    std::vector<float> texels;
  };

  void BuildTiles(const image::FrameImage& image);
  void BuildPlanes();
  // The depth that a texel must be nearer than to hide the footprint's block there.
  [[nodiscard]] float LimitOf(const view::Footprint& footprint) const {
    return kind_ == MapKind::kMask ? kUncovered : footprint.nearest_depth;
  }
  [[nodiscard]] int level_count() const { return kTileLevels + static_cast<int>(planes_.size()); }
  // The farthest depth in texel (x, y) of a level.
  [[nodiscard]] float TexelAt(int level, int x, int y) const;
  // Bit x - begin_x is set if texel (x, y) of a level is not nearer than `limit`.
  // REQUIRES: at most 32 texels.
  [[nodiscard]] std::uint32_t OpenTexels(int level, int y, int begin_x, int end_x,
                                         float limit) const;
  // True if all pixels of `rect` that lie in texel (x, y) of `level` are nearer than `limit`.
  [[nodiscard]] bool IsNearer(int level, int x, int y, const view::PixelRect& rect,
                              float limit) const;

  MapKind kind_ = MapKind::kDepth;
  int width_px_ = 0;
  int height_px_ = 0;
  // Where the texels of each tile are, row by row, in units of kTileTexels; 0: all uncovered.
  std::vector<std::uint32_t> slots_;
  std::unique_ptr<float[]> tiles_;
  std::vector<Plane>
      planes_;  // levels 4 and up; each next one halves both sides; the last is 1 x 1
};

}  // namespace isoscope::visibility

#endif  // ISOSCOPE_CORE_VISIBILITY_OCCLUSION_MAP_H_
