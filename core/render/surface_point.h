// Shading in doubles of single pixels, for those that ComputeShadeSteps reports as inexact.

#ifndef ISOSCOPE_CORE_RENDER_SURFACE_POINT_H_
#define ISOSCOPE_CORE_RENDER_SURFACE_POINT_H_

#include <array>
#include <cstdint>

#include "core/math/vec.h"
#include "core/mesh/compact_mesh.h"
#include "core/view/view.h"

namespace isoscope::render {

// A point of a triangle.
struct SurfacePoint {
  math::Vec3d normal;               // world space, of no particular length
  math::Vec3d position;             // index space
  std::array<double, 3> weights{};  // of the corners; they add up to 1
};

// Returns the map level of the point, mixed as ComputeShadeSteps does. `levels`: of the corners.
inline float MixMapLevels(const SurfacePoint& point, const std::array<float, 3>& levels) {
  const auto a = static_cast<double>(levels[0]);
  return static_cast<float>(a + ((static_cast<double>(levels[1]) - a) * point.weights[1] +
                                 (static_cast<double>(levels[2]) - a) * point.weights[2]));
}

// Returns the point of a triangle at the centre of pixel (x, y) of the picture. A pure function of
// its arguments, as ShadeStepAt is.
SurfacePoint SurfacePointAt(const view::View& view, const mesh::CompactMesh& mesh,
                            std::uint32_t triangle, int x, int y);

// Returns the step of |n . v| at the point, 0 to kShadeSteps, as ComputeShadeSteps does.
std::uint32_t ShadeStepAt(const view::View& view, const SurfacePoint& point);

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_SURFACE_POINT_H_
