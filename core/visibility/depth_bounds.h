// Bounds of depth: for each pixel the nearest and the farthest depth that the exact picture can
// have there. Only spans and the view are known, no samples.
//
// A block that may have a part of a surface covers at most the pixels of its footprint, between two
// depths. A pixel under no such block is background, proved. Bounds are minima and maxima: neither
// the order of the blocks nor their division into parts can show in them. They depend on how the
// volume is cut (docs/numerics.md, "Bounds of depth").

#ifndef ISOSCOPE_CORE_VISIBILITY_DEPTH_BOUNDS_H_
#define ISOSCOPE_CORE_VISIBILITY_DEPTH_BOUNDS_H_

#include <cstddef>
#include <span>
#include <vector>

#include "core/view/clip_region.h"
#include "core/view/view.h"
#include "core/volume/block_layout.h"

namespace isoscope::visibility {

// Two planes of window depths in [0, 1], row 0 at the top. Memory: 8 bytes a pixel.
// Thread-compatible.
class DepthBounds {
 public:
  // The bounds of a pixel under no block: they are neutral in minima and maxima.
  static constexpr float kNoNearest = 2.0F;
  static constexpr float kNoFarthest = -1.0F;

  DepthBounds() = default;
  // Makes bounds without a block. REQUIRES: both are at least 0.
  DepthBounds(int width_px, int height_px);
  // REQUIRES: both planes have width_px * height_px values, valid as AreValid says.
  DepthBounds(int width_px, int height_px, std::vector<float> nearest, std::vector<float> farthest);

  // Whether two values can be the bounds of a pixel: 0 <= nearest <= farthest <= 1, or none.
  static bool AreValid(float nearest, float farthest);

  [[nodiscard]] int width_px() const { return width_px_; }
  [[nodiscard]] int height_px() const { return height_px_; }
  [[nodiscard]] std::span<const float> nearest() const { return nearest_; }
  [[nodiscard]] std::span<const float> farthest() const { return farthest_; }
  [[nodiscard]] bool IsBackground(std::size_t pixel) const { return nearest_[pixel] == kNoNearest; }

  // Adds fragments between two depths to the rows [begin_row, end_row) of a rectangle. Calls for
  // different rows may run at the same time.
  // REQUIRES: the rectangle lies inside the picture, AreValid(nearest, farthest).
  void AddToRows(const view::PixelRect& rect, float nearest, float farthest, int begin_row,
                 int end_row);
  // Adds the fragments that `other` bounds. REQUIRES: it has the same size.
  void UniteWith(const DepthBounds& other);

  friend bool operator==(const DepthBounds&, const DepthBounds&) = default;

 private:
  int width_px_ = 0;
  int height_px_ = 0;
  std::vector<float> nearest_;
  std::vector<float> farthest_;
};

// The blocks to bound. All objects that it points to outlive the call.
struct BoundedBlocks {
  const view::View* view = nullptr;  // of the volume, level 0
  const volume::BlockLayout* layout = nullptr;
  const view::Clipper* clipper = nullptr;  // of the picture
  std::span<const volume::BlockId> ids;    // of the layout, in any order
};

// Adds the triangles that active blocks may have. Blocks that are wholly clipped have none. Works
// in parallel, in the caller's TBB arena. O(footprints' pixels), and memory for some thousand
// footprints. REQUIRES: `bounds` has the size of the view's picture.
void AddSurfaceBlocks(const BoundedBlocks& active, DepthBounds* bounds);

// Adds the caps that blocks may have. Only blocks that the border of the clip region cuts have some.
// Else as AddSurfaceBlocks.
//
// near_inside: those with an inside sample of an opaque surface, and all 26 neighbours of each: a ray
//              beside the pixel may decide, in a block beside (docs/numerics.md, "Caps")
void AddCapBlocks(const BoundedBlocks& near_inside, DepthBounds* bounds);

}  // namespace isoscope::visibility

#endif  // ISOSCOPE_CORE_VISIBILITY_DEPTH_BOUNDS_H_
