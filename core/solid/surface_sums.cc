#include "core/solid/surface_sums.h"

namespace isoscope::solid {

void SurfaceSums::AddTriangle(const std::array<math::Vec3d, 3>& corners) {
  const auto& [a, b, c] = corners;
  area.Add(math::Length(math::Cross(b - a, c - a)) / 2);
  // The tetrahedron with the point (Gauss: the volume is the flux of x / 3).
  volume.Add(math::Dot(a, math::Cross(b, c)) / 6);
  ++triangle_count;
}

void SurfaceSums::Add(const SurfaceSums& other) {
  area.Add(other.area);
  volume.Add(other.volume);
  triangle_count += other.triangle_count;
  open_side_count += other.open_side_count;
}

std::optional<SurfaceSums> TotalOf(const std::vector<std::optional<SurfaceSums>>& parts) {
  SurfaceSums total;
  for (const std::optional<SurfaceSums>& part : parts) {
    if (!part.has_value()) {
      return std::nullopt;
    }
    total.Add(*part);
  }
  return total;
}

}  // namespace isoscope::solid
