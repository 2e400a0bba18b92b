// Finds the points where the rays through pixels enter and leave a clip region. Caps are drawn
// there.
//
// A region is convex, so a ray has one interval in it: from the last half-space that it enters to
// the first that it leaves. At the edge between two planes, one of the two is taken, so that no ray
// passes between them.

#ifndef ISOSCOPE_CORE_VIEW_CLIP_CROSSINGS_H_
#define ISOSCOPE_CORE_VIEW_CLIP_CROSSINGS_H_

#include <cstddef>
#include <optional>
#include <vector>

#include "core/math/vec.h"
#include "core/view/clip_region.h"
#include "core/view/view.h"

namespace isoscope::view {

// A point on the border of the clip region, inside the volume and behind the near plane.
struct ClipCrossing {
  math::Vec3d position;        // index space
  std::size_t half_space = 0;  // the half-space with this border, in Clipper::half_spaces()
  float depth = 0;             // window depth, in [0, 1]
};

struct ClipCrossings {
  std::optional<ClipCrossing> entry;
  std::optional<ClipCrossing> exit;
};

// Immutable; thread-safe. Computes in double, with the same bits on every machine and for every
// region of a viewport.
class ClipCrossingFinder {
 public:
  // Copies its arguments.
  ClipCrossingFinder(const View& view, const Clipper& clipper);

  // Returns the crossings of the ray through (x, y), in pixels of the whole viewport: the centre of
  // its first pixel is (0.5, 0.5). A border of the region that lies on the volume's border counts.
  [[nodiscard]] ClipCrossings At(double x, double y) const;

  // Returns the ray's direction in world space, of no particular length.
  [[nodiscard]] math::Vec3d DirectionAt(double x, double y) const {
    return world_direction_.At(x, y);
  }

 private:
  // The distance to a half-space's border at the ray's origin, and how fast it grows along it.
  struct Approach {
    Linear<double> distance;
    Linear<double> rate;
  };

  [[nodiscard]] std::optional<ClipCrossing> CrossingAt(double x, double y, double t,
                                                       std::size_t half_space) const;

  math::Mat4d clip_from_index_;
  math::Vec3d last_sample_;
  LinearVec3d world_direction_;
  PixelRays rays_;                    // index space
  std::vector<Approach> approaches_;  // by half-space
};

}  // namespace isoscope::view

#endif  // ISOSCOPE_CORE_VIEW_CLIP_CROSSINGS_H_
