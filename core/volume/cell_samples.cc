#include "core/volume/cell_samples.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "core/base/coding.h"
#include "core/volume/scalar_type.h"

namespace isoscope::volume {

std::array<double, 8> SamplesOfCell(const BlockSamples& samples, const math::IndexBox& stored,
                                    const math::Index3& cell) {
  const math::Index3 dims = stored.dims();
  const math::Index3 local = cell - stored.begin;
  std::array<double, 8> corners;
  VisitScalarType(samples.type, [&]<typename T>() {
    for (std::size_t c = 0; c < 8; ++c) {
      const auto i = static_cast<std::int64_t>(c);
      const std::int64_t x = local.x + (i & 1);
      const std::int64_t y = local.y + (i >> 1 & 1);
      const std::int64_t z = local.z + (i >> 2);
      const auto at = static_cast<std::size_t>(x + dims.x * (y + dims.y * z));
      corners[c] = static_cast<double>(base::LoadLittleEndian<T>(samples.bytes + at * sizeof(T)));
    }
  });
  return corners;
}

double ValueInCell(const std::array<double, 8>& corners, const math::Index3& cell,
                   const math::Vec3d& position) {
  double sum = 0;
  for (int c = 0; c < 8; ++c) {
    double weight = 1;
    for (int axis = 0; axis < 3; ++axis) {
      const double along = std::clamp(position[axis] - static_cast<double>(cell[axis]), 0.0, 1.0);
      weight *= (c >> axis & 1) != 0 ? along : 1 - along;
    }
    if (weight > 0) {
      sum += weight * corners[static_cast<std::size_t>(c)];
    }
  }
  return sum;
}

}  // namespace isoscope::volume
