#include "core/view/unprojection.h"

namespace isoscope::view {

Unprojection::Unprojection(const View& view)
    : is_perspective_(view.image_plane().is_perspective),
      near_distance_(view.near_distance()),
      far_distance_(view.far_distance()),
      eye_(view.camera().eye),
      forward_(view.forward()),
      first_x_(view.region().x + 0.5 - static_cast<double>(view.viewport().width_px) / 2),
      first_y_(view.region().y + 0.5 - static_cast<double>(view.viewport().height_px) / 2),
      per_x_(view.right() * view.image_plane().pixel_size),
      per_y_(view.up() * -view.image_plane().pixel_size) {}

math::Vec3d Unprojection::PositionOf(int x, int y, float distance) const {
  const math::Vec3d offset = per_x_ * (first_x_ + x) + per_y_ * (first_y_ + y);
  const auto d = static_cast<double>(distance);
  return is_perspective_ ? eye_ + (forward_ + offset) * d : eye_ + offset + forward_ * d;
}

}  // namespace isoscope::view
