// The gradient of the field at any point: what the normals of surfaces show the direction of.

#ifndef ISOSCOPE_CORE_VOLUME_FIELD_GRADIENT_H_
#define ISOSCOPE_CORE_VOLUME_FIELD_GRADIENT_H_

#include "core/math/vec.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_samples.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::volume {

// Returns the cell that a point lies in, that of the greatest index if it lies in several; a point
// outside of the volume counts for the nearest cell. REQUIRES: the position is finite.
//
// position: in index space (samples)
math::Index3 CellAt(const BlockLayout& layout, const math::Vec3d& position);

// Returns the block that has a cell. REQUIRES: it is one of the volume's.
BlockId BlockOfCell(const BlockLayout& layout, const math::Index3& cell);

// Returns the gradient at a point, in field units for each world unit, world space: those of the
// eight samples of its cell, interpolated linearly on each axis. That of a sample is the central
// difference, or the one to the only finite neighbour; 0 on an axis where there is none, or where
// the difference overflows. It follows from the samples alone, not from how the volume is cut into
// blocks.
//
// samples: of the block that has CellAt(layout, position)
math::Vec3d GradientAt(const GridGeometry& geometry, const BlockLayout& layout,
                       const BlockSamples& samples, const math::Vec3d& position);

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_FIELD_GRADIENT_H_
