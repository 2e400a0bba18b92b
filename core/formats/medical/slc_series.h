// SLC files of VolVis, the volumes of bytes that VTK's SLC reader takes.

#ifndef ISOSCOPE_CORE_FORMATS_MEDICAL_SLC_SERIES_H_
#define ISOSCOPE_CORE_FORMATS_MEDICAL_SLC_SERIES_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/volume_series.h"

namespace isoscope::source {

// True if a file begins so: with the number 11111.
bool IsSlc(absl::string_view head);

// Opens the file as one field of that name, of uint8, plain or in runs (a slice is decoded whole).
// The world is that of the spacing alone. INVALID_ARGUMENT: no such header; more than 8 bits a
// voxel; another compression; the file ends early; runs that can't give as many voxels. DATA_LOSS:
// runs that give fewer voxels, or more.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenSlcSeries(const std::string& file,
                                                            const std::string& field);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_MEDICAL_SLC_SERIES_H_
