// A VTK RectilinearGrid file (.vtr) with all its arrays.

#ifndef ISOSCOPE_CORE_FORMATS_VTK_VTR_IMAGE_H_
#define ISOSCOPE_CORE_FORMATS_VTK_VTR_IMAGE_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "core/formats/vtk/vtk_image.h"
#include "core/source/grid/grid_rules.h"

namespace isoscope::source {

// Opens the file in the formats of OpenVtiArray, with its arrays of numbers, or `part`, as
// OpenVtkImage. The coordinates are world positions. INVALID_ARGUMENT: not such a file; several
// pieces; other than three arrays of coordinates, or not as many as points; as RectilinearGridOf.
// If the rules resample, volumes are resampled as they are opened, with errors as ResampleSource.
absl::StatusOr<std::unique_ptr<VtkImage>> OpenVtrImage(const std::string& path,
                                                       const std::string& part,
                                                       const GridRules& rules);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_VTK_VTR_IMAGE_H_
