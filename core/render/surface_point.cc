#include "core/render/surface_point.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "core/math/matrix.h"
#include "core/render/cpu_rasterizer.h"
#include "core/render/shade_kernel.h"

namespace isoscope::render {

SurfacePoint SurfacePointAt(const view::View& view, const mesh::CompactMesh& mesh,
                            std::uint32_t triangle, int x, int y) {
  const std::array<double, 3> weights = BarycentricsAtPixel(mesh, triangle, view, x, y);
  SurfacePoint point;
  point.weights = weights;
  const std::array<std::uint32_t, 3> corners = mesh.triangles[triangle];
  for (std::size_t i = 0; i < 3; ++i) {
    const mesh::CompactNormal& n = mesh.normals[corners[i]];
    const math::Vec3f& p = mesh.positions[corners[i]];
    point.normal = point.normal + math::Vec3d{static_cast<double>(n.x), static_cast<double>(n.y),
                                              static_cast<double>(n.z)} *
                                      weights[i];
    point.position =
        point.position +
        math::Vec3d{static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z)} *
            weights[i];
  }
  return point;
}

std::uint32_t ShadeStepAt(const view::View& view, const SurfacePoint& point) {
  const math::Vec3d& normal = point.normal;
  const math::Vec3d& position = point.position;
  math::Vec3d to_eye = -view.forward();
  if (view.camera().projection == view::Projection::kPerspective) {
    to_eye = view.camera().eye - math::TransformPoint(view.world_from_index(), position);
  }
  const double scale = math::Dot(normal, normal) * math::Dot(to_eye, to_eye);
  // Without a normal the surface is shaded as if it faced the eye.
  const double cosine =
      scale > 0 ? std::min(std::abs(math::Dot(normal, to_eye)) / std::sqrt(scale), 1.0) : 1.0;
  return static_cast<std::uint32_t>(std::lround(cosine * kShadeSteps));
}

}  // namespace isoscope::render
