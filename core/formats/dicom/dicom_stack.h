// Slices of a DICOM series as one volume.

#ifndef ISOSCOPE_CORE_FORMATS_DICOM_DICOM_STACK_H_
#define ISOSCOPE_CORE_FORMATS_DICOM_DICOM_STACK_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/formats/dicom/dicom_steps.h"
#include "core/source/grid/grid_rules.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {

struct SliceStack {
  volume::GridGeometry geometry{};
  // The places of the slices along the third axis, from the first one on; none if they are even.
  std::vector<double> distances{};
};

// INVALID_ARGUMENT: slices of several orientations, as those of a localizer. Lists how many each
// has, with a slice of it.
absl::Status CheckParallel(const std::vector<DicomSlice>& slices, const std::string& name);

// Sorts slices by position, checks that they are one volume, and returns its geometry. The first
// pixels lie on the normal of the slices, or on a line that leans (a tilted gantry), which is then
// the third axis. INVALID_ARGUMENT: fewer than two slices; different size, orientation or spacing
// of pixels, which --spacing does not replace; several units of values or frames of reference;
// pixels beside the line; a slice that is there twice; and, unless the rules resample,
// distances that differ by more than 1 % from their mean, or that add up to a tenth of a distance
// (says which slices are missing, if the others lie evenly).
absl::StatusOr<SliceStack> StackSlices(std::vector<DicomSlice>* slices, const std::string& name,
                                       const GridRules& rules);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_DICOM_DICOM_STACK_H_
