// The gradient of the field at any point. The normals of surfaces have its direction.

#ifndef ISOSCOPE_CORE_VOLUME_FIELD_GRADIENT_H_
#define ISOSCOPE_CORE_VOLUME_FIELD_GRADIENT_H_

#include "core/math/vec.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_samples.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::volume {

// Returns the cell of a point: the one with the greatest index if it lies in several, the nearest
// one if it lies outside the volume. REQUIRES: the position is finite.
//
// position: in index space (samples)
math::Index3 CellAt(const BlockLayout& layout, const math::Vec3d& position);

// Returns the block that has a cell. REQUIRES: it is one of the volume's.
BlockId BlockOfCell(const BlockLayout& layout, const math::Index3& cell);

// Returns the gradient at a point, in field units for each world unit, in world space: the
// gradients at the eight samples of its cell, interpolated linearly on each axis. At a sample it is
// the central difference, or the difference to the only finite neighbour. It is 0 on an axis
// without a finite neighbour, or where the difference overflows. It depends on the samples alone,
// not on the division into blocks.
//
// samples: of the block that has CellAt(layout, position)
math::Vec3d GradientAt(const GridGeometry& geometry, const BlockLayout& layout,
                       const BlockSamples& samples, const math::Vec3d& position);

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_FIELD_GRADIENT_H_
