#include "core/volume/field_gradient.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "core/base/coding.h"
#include "core/math/box.h"
#include "core/math/matrix.h"
#include "core/volume/scalar_type.h"

namespace isoscope::volume {
namespace {

double SampleAt(const BlockSamples& samples, const math::IndexBox& stored, const math::Index3& p) {
  const math::Index3 dims = stored.dims();
  const math::Index3 local = p - stored.begin;
  const auto linear = static_cast<std::size_t>(local.x + dims.x * (local.y + dims.y * local.z));
  return VisitScalarType(samples.type, [&]<typename T>() {
    return static_cast<double>(base::LoadLittleEndian<T>(samples.bytes + linear * sizeof(T)));
  });
}

// Returns the gradient in index space. The stored samples include all existing neighbours of the
// block's own samples.
math::Vec3d GradientAtSample(const BlockSamples& samples, const math::IndexBox& stored,
                             const math::Index3& p) {
  math::Vec3d gradient;
  for (int axis = 0; axis < 3; ++axis) {
    // The sample itself replaces a neighbour that is missing or not finite.
    const auto neighbour = [&](std::int64_t step) {
      math::Index3 at = p;
      at[axis] += step;
      return at[axis] >= stored.begin[axis] && at[axis] < stored.end[axis] &&
                     std::isfinite(SampleAt(samples, stored, at))
                 ? at
                 : p;
    };
    const math::Index3 lower = neighbour(-1);
    const math::Index3 upper = neighbour(1);
    const std::int64_t steps = upper[axis] - lower[axis];
    const double difference = SampleAt(samples, stored, upper) - SampleAt(samples, stored, lower);
    gradient[axis] =
        steps > 0 && std::isfinite(difference) ? difference / static_cast<double>(steps) : 0;
  }
  return gradient;
}

}  // namespace

math::Index3 CellAt(const BlockLayout& layout, const math::Vec3d& position) {
  math::Index3 cell;
  for (int axis = 0; axis < 3; ++axis) {
    const std::int64_t last = layout.sample_dims()[axis] - 2;
    cell[axis] = static_cast<std::int64_t>(
        std::clamp(std::floor(position[axis]), 0.0, static_cast<double>(last)));
  }
  return cell;
}

BlockId BlockOfCell(const BlockLayout& layout, const math::Index3& cell) {
  const math::Index3& size = layout.block_cells();
  return layout.IdOf({cell.x / size.x, cell.y / size.y, cell.z / size.z});
}

math::Vec3d GradientAt(const GridGeometry& geometry, const BlockLayout& layout,
                       const BlockSamples& samples, const math::Vec3d& position) {
  const math::IndexBox stored = layout.StoredSamplesOf(samples.block_id);
  const math::Index3 cell = CellAt(layout, position);
  math::Vec3d along;  // from the cell's first corner, in cells
  for (int axis = 0; axis < 3; ++axis) {
    along[axis] = std::clamp(position[axis] - static_cast<double>(cell[axis]), 0.0, 1.0);
  }
  math::Vec3d sum;
  for (int corner = 0; corner < 8; ++corner) {
    const math::Index3 offset{corner & 1, corner >> 1 & 1, corner >> 2};
    double weight = 1;
    for (int axis = 0; axis < 3; ++axis) {
      weight *= offset[axis] != 0 ? along[axis] : 1 - along[axis];
    }
    if (weight > 0) {
      sum = sum + GradientAtSample(samples, stored, cell + offset) * weight;
    }
  }
  return geometry.world_gradient_from_index() * sum;
}

}  // namespace isoscope::volume
