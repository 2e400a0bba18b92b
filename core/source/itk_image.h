// Formats that ITK reads, in a process of its own: BioRad, Stimulate, and slices in PNG or BMP.

#ifndef ISOSCOPE_CORE_SOURCE_ITK_IMAGE_H_
#define ISOSCOPE_CORE_SOURCE_ITK_IMAGE_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/volume_series.h"
#include "core/source/volume_source.h"

namespace isoscope::source {

// Opens a BioRad (.pic) or Stimulate (.spr) file of one volume; the ending of its name decides. The
// first read takes the whole volume into the memory of the child. `field` names the field.
// INVALID_ARGUMENT: not of that format; not three-dimensional; several components or 64-bit
// integers. DATA_LOSS: the file is cut, or its library ended the child.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenItkImage(const std::string& path,
                                                           const std::string& field);

// Whether the name of a file is one of a slice: .png .bmp, in any case.
bool IsItkSliceName(const std::string& path);

// Opens the slices that `path`, a folder or a pattern, names (FilesNamed), one image each: grey, of
// one size and type. They are read one at a time; the spacing is 1, since such files have only that
// of a print. INVALID_ARGUMENT: no slices; colours; slices of different size or type, which are
// found when they are read. DATA_LOSS: as above.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenItkSlices(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_ITK_IMAGE_H_
