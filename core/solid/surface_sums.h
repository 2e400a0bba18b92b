// Area, enclosed volume and openness of a surface, summed over its triangles. The sums are exact:
// they depend neither on blocks nor on their order.

#ifndef ISOSCOPE_CORE_SOLID_SURFACE_SUMS_H_
#define ISOSCOPE_CORE_SOLID_SURFACE_SUMS_H_

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "core/math/exact_sum.h"
#include "core/math/vec.h"

namespace isoscope::solid {

// A value type. Thread-compatible.
struct SurfaceSums {
  math::ExactSum area;    // world units squared
  math::ExactSum volume;  // world units cubed; means nothing if the surface is open
  std::int64_t triangle_count = 0;
  // Sides with one triangle.
  std::int64_t open_side_count = 0;

  // corners: in the world, from a point that is the same for the whole surface; counter-clockwise
  //          seen from outside
  void AddTriangle(const std::array<math::Vec3d, 3>& corners);
  void Add(const SurfaceSums& other);
};

// Returns the sums of all parts; none if a part has none.
std::optional<SurfaceSums> TotalOf(const std::vector<std::optional<SurfaceSums>>& parts);

}  // namespace isoscope::solid

#endif  // ISOSCOPE_CORE_SOLID_SURFACE_SUMS_H_
