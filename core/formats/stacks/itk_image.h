// Formats that ITK reads: BioRad and Stimulate, in a process of its own, and slices in PNG or BMP.

#ifndef ISOSCOPE_CORE_FORMATS_STACKS_ITK_IMAGE_H_
#define ISOSCOPE_CORE_FORMATS_STACKS_ITK_IMAGE_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/bytes/slice_image.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"

namespace isoscope::source {

// Opens a BioRad (.pic) or Stimulate (.spr) file of one volume; the ending of its name decides. The
// first read takes the whole volume into the memory of the child. `field` names the field.
// INVALID_ARGUMENT: not of that format; not three-dimensional; several components or 64-bit
// integers. DATA_LOSS: the file is cut, or its library ended the child.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenItkImage(const std::string& path,
                                                           const std::string& field);

// Reads a slice in PNG or BMP; the ending of its name decides. For the child, since ITK may end the
// process. INVALID_ARGUMENT: not of that format; colours or a palette. DATA_LOSS: the file is cut.
absl::StatusOr<SliceImage> ReadItkSlice(const std::string& path, SlicePart part);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_STACKS_ITK_IMAGE_H_
