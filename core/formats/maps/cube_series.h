// Gaussian cube files: densities and orbitals of molecules.

#ifndef ISOSCOPE_CORE_FORMATS_MAPS_CUBE_SERIES_H_
#define ISOSCOPE_CORE_FORMATS_MAPS_CUBE_SERIES_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/volume_series.h"

namespace isoscope::source {

// Opens the file as one field of that name, of float32: its numbers have five or six digits. Index
// x runs along the third vector of the grid, which is the fastest in the file. The unit is that of
// the file, bohr or, with a negative number of voxels, angstrom. Several values a voxel are
// components, with the numbers of the orbitals as names. Atoms are passed over.
//
// INVALID_ARGUMENT: no such header; vectors that span no grid; the file ends early.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenCubeSeries(const std::string& file,
                                                             const std::string& field);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_MAPS_CUBE_SERIES_H_
