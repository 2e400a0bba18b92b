// The grid of a header that has a transform from indices to the world.

#ifndef ISOSCOPE_CORE_SOURCE_GRID_AFFINE_GRID_H_
#define ISOSCOPE_CORE_SOURCE_GRID_AFFINE_GRID_H_

#include <array>
#include <optional>
#include <string>

#include "absl/status/statusor.h"

#include "core/math/matrix.h"
#include "core/math/vec.h"
#include "core/source/grid/grid_faults.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {

// Rows of the transform: world[r] = rows[r][0] x + rows[r][1] y + rows[r][2] z + rows[r][3].
using AffineRows = std::array<std::array<double, 4>, 3>;

enum class PatientWorld { kRas, kLps };

// Two axes of indices that do not meet at a right angle.
struct Shear {
  int first_axis = 0;
  int second_axis = 1;
  double cosine = 0;  // of their angle
};
// The worst pair of axes, if its cosine is beyond 0.0003 on either side: rounded text and floats
// stay far below. Not set if an axis has no length.
std::optional<Shear> FindShear(const AffineRows& rows);
std::optional<Shear> FindShear(const math::Mat3d& directions);  // columns
double DegreesOf(const Shear& shear);
// INVALID_ARGUMENT: names the axes, their angle, and the flag that ignores it.
absl::Status ShearError(const Shear& shear, const std::string& path);

// The grid in LPS: RAS changes the signs of x and y. The columns of the direction are those of the
// transform, sheared or not: the caller refuses what FindShear finds, unless the format means it.
// INVALID_ARGUMENT: numbers that are none, or axes without a length, unless they can be told by
// `faults`; volume::Validate.
absl::StatusOr<volume::GridGeometry> GridFromAffine(const math::Index3& dims,
                                                    const AffineRows& rows, PatientWorld world,
                                                    const std::string& path,
                                                    GridFaults* faults = nullptr);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_GRID_AFFINE_GRID_H_
