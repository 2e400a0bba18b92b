// Which level of a volume a frame is drawn from (core/volume/volume_level.h): named, or the coarsest
// one whose samples are close enough on the screen.
//
// The choice follows from the grid of level 0, the clip box, the camera and the whole viewport. It
// does not depend on blocks, rules, samples a pixel or regions, so that no cut of the volume or of
// the picture shows. All functions are pure and thread-safe.

#ifndef ISOSCOPE_CORE_VIEW_LEVEL_CHOICE_H_
#define ISOSCOPE_CORE_VIEW_LEVEL_CHOICE_H_

#include <optional>

#include "core/math/box.h"
#include "core/math/vec.h"
#include "core/view/view.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::view {

// Either names a level, or limits the distance between samples on the screen.
struct LevelChoice {
  std::optional<int> level;   // 0 to volume::kMaxLevel
  double max_spacing_px = 0;  // if no level is named: pixels, > 0, finite

  friend bool operator==(const LevelChoice&, const LevelChoice&) = default;
};

// Returns the pixels of the viewport that one world unit across the view direction covers at the
// nearest point of the volume, within the clip box, that is not in front of the near plane. 0: there
// is no such point. Directions across the picture don't count: the point may lie beside it.
//
// view: of level 0
double PixelsPerUnit(const View& view, const std::optional<math::Box3d>& clip_box);

// Returns the distances between neighbouring samples along each axis, in world units.
math::Vec3d WorldSpacing(const volume::GridGeometry& grid);

// Returns the pixels that the largest of these distances covers.
double SpacingPx(const volume::GridGeometry& grid, double pixels_per_unit);

// Returns the coarsest of the levels 0 to `highest_level` whose largest distance between samples
// covers at most `max_spacing_px` pixels; 0 if none does.
//
// grid: of level 0
int CoarsestLevel(const volume::GridGeometry& grid, double pixels_per_unit, double max_spacing_px,
                  int highest_level);

}  // namespace isoscope::view

#endif  // ISOSCOPE_CORE_VIEW_LEVEL_CHOICE_H_
