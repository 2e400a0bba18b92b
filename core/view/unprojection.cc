#include "core/view/unprojection.h"

#include "core/math/elementary.h"

namespace isoscope::view {

Unprojection::Unprojection(const View& view)
    : is_perspective_(view.camera().projection == Projection::kPerspective),
      near_distance_(view.near_distance()),
      far_distance_(view.far_distance()),
      eye_(view.camera().eye),
      forward_(view.forward()) {
  const double width = view.viewport().width_px;
  const double height = view.viewport().height_px;
  const double half_height =
      is_perspective_ ? math::Tan(view.camera().fov_y_radians / 2) : view.camera().view_height / 2;
  const double pixel = 2 * half_height / height;
  per_x_ = view.right() * pixel;
  per_y_ = view.up() * -pixel;
  first_x_ = view.region().x + 0.5 - width / 2;
  first_y_ = view.region().y + 0.5 - height / 2;
}

math::Vec3d Unprojection::PositionOf(int x, int y, float distance) const {
  const math::Vec3d offset = per_x_ * (first_x_ + x) + per_y_ * (first_y_ + y);
  const auto d = static_cast<double>(distance);
  return is_perspective_ ? eye_ + (forward_ + offset) * d : eye_ + offset + forward_ * d;
}

}  // namespace isoscope::view
