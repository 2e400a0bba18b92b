// Converts a pixel and its window depth back to the distance from the eye, and to world space.

#ifndef ISOSCOPE_CORE_VIEW_UNPROJECTION_H_
#define ISOSCOPE_CORE_VIEW_UNPROJECTION_H_

#include "core/math/vec.h"
#include "core/view/view.h"

namespace isoscope::view {

// Immutable; thread-safe. Computes in double, with the same bits on every machine.
class Unprojection {
 public:
  explicit Unprojection(const View& view);

  // Returns the distance from the eye along the view axis, in world units, of a window depth in
  // [0, 1]: near_distance at 0, far_distance at 1. float32 so that planes and picks agree.
  [[nodiscard]] float DistanceOf(float depth) const {
    const auto z = static_cast<double>(depth);
    const double range = far_distance_ - near_distance_;
    // The inverse of z = far (d - near) / (d (far - near)).
    return static_cast<float>(is_perspective_
                                  ? far_distance_ * near_distance_ / (far_distance_ - z * range)
                                  : near_distance_ + z * range);
  }

  // Returns the point in world space that is seen at the centre of pixel (x, y) of the picture, at
  // `distance` from the eye along the view axis.
  [[nodiscard]] math::Vec3d PositionOf(int x, int y, float distance) const;
  // Returns PositionOf(x, y, distance)[axis], bit for bit.
  [[nodiscard]] double CoordinateOf(int axis, int x, int y, float distance) const {
    const double offset = per_x_[axis] * (first_x_ + x) + per_y_[axis] * (first_y_ + y);
    const auto d = static_cast<double>(distance);
    return is_perspective_ ? eye_[axis] + (forward_[axis] + offset) * d
                           : eye_[axis] + offset + forward_[axis] * d;
  }

 private:
  bool is_perspective_ = true;
  double near_distance_ = 0;
  double far_distance_ = 0;
  math::Vec3d eye_;
  math::Vec3d forward_;
  // The centre of the picture's first pixel, in pixels from the middle of the whole: halves, so
  // that a region's pixel has the bits of the whole's.
  double first_x_ = 0;
  double first_y_ = 0;
  // The steps to the next column and row of the image plane (perspective: at distance 1).
  math::Vec3d per_x_;
  math::Vec3d per_y_;
};

}  // namespace isoscope::view

#endif  // ISOSCOPE_CORE_VIEW_UNPROJECTION_H_
