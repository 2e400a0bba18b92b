#include "core/view/farthest_depth.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "core/math/box.h"
#include "core/math/matrix.h"
#include "core/view/footprint_kernel.h"

namespace isoscope::view {
namespace {

// Returns the least float that is not below `depth`, at most 1; 1 for NaN.
float RoundAwayFromViewer(double depth) {
  if (!(depth < 1)) {
    return 1;
  }
  auto rounded = static_cast<float>(std::max(depth, 0.0));
  if (static_cast<double>(rounded) < depth) {
    rounded = std::nextafter(rounded, 2.0F);
  }
  return rounded;
}

// Returns the sum of the sizes of the products of one clip coordinate: its error is a part of it.
double ReachOf(const math::Mat4d& m, std::size_t row, const math::Vec3d& size) {
  return std::abs(m.m[row]) * size.x + std::abs(m.m[4 + row]) * size.y +
         std::abs(m.m[8 + row]) * size.z + std::abs(m.m[12 + row]);
}

}  // namespace

float FarthestDepthOf(const View& view, const math::Vec3d& index_min, const math::Vec3d& index_max,
                      const Footprint& footprint) {
  if (footprint.nearest_depth == 0) {
    return 1;  // it may reach the near plane: float32 need not hold its coordinates
  }
  const math::Mat4d& m = view.clip_from_index();
  math::Vec3d size;
  for (int axis = 0; axis < 3; ++axis) {
    size[axis] = std::max(std::abs(index_min[axis]), std::abs(index_max[axis]));
  }
  double max_z = -1;  // nothing on the screen is in front of the near plane
  double min_w = std::numeric_limits<double>::infinity();
  for (const math::Vec3d& p : math::Box3d{index_min, index_max}.Corners()) {
    const math::Vec4d clip = m * math::Vec4d{p.x, p.y, p.z, 1};
    max_z = std::max(max_z, clip.z / clip.w);
    min_w = std::min(min_w, clip.w);
  }
  // The margin of View::FootprintOf, for the z axis: abs(z / w) is at most 1 on the screen, and
  // what lies behind the far plane is shown at it.
  const double reach = std::min(std::max(max_z, 1.0), 2.0);
  const double w_error = kClipError * ReachOf(m, 3, size);
  const double clip_error =
      (kClipError * ReachOf(m, 2, size) + reach * w_error) / (min_w - w_error);
  const double margin = clip_error + kViewportError * (reach + 1);
  return std::max(RoundAwayFromViewer(0.5 * (max_z + margin) + 0.5), footprint.nearest_depth);
}

}  // namespace isoscope::view
