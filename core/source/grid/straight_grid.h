// The nearest grid whose axes meet at right angles: --ignore-shear.

#ifndef ISOSCOPE_CORE_SOURCE_GRID_STRAIGHT_GRID_H_
#define ISOSCOPE_CORE_SOURCE_GRID_STRAIGHT_GRID_H_

#include <string>

#include "core/math/matrix.h"
#include "core/source/grid/affine_grid.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {

// The orthonormal matrix nearest to `directions`, columns of length 1: the one with the least sum
// of squared differences of elements, which is the polar factor. It keeps the handedness.
// REQUIRES: the columns are independent.
math::Mat3d NearestRightAngles(const math::Mat3d& directions);

// The grid of the nearest right angles. The first sample keeps its place, and each axis the
// distance of its samples. REQUIRES: `geometry` is valid.
volume::GridGeometry StraightGrid(const volume::GridGeometry& geometry);

// "axes x and y, which meet at 83.1 degrees, were made straight; samples moved by up to 4.2".
std::string DescribeStraightening(const Shear& shear, const volume::GridGeometry& from,
                                  const volume::GridGeometry& to);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_GRID_STRAIGHT_GRID_H_
