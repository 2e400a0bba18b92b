// MINC 2, by ITK and libminc.

#ifndef ISOSCOPE_CORE_SOURCE_MINC_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_MINC_SOURCE_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/volume_series.h"
#include "core/source/volume_source.h"

namespace isoscope::source {

// Opens a MINC 2 file, which is HDF5, as one field of that name. The libraries run in a child
// process, which reads a plane at a time. Values are the real ones, in LPS. INVALID_ARGUMENT: MINC
// 1 (says how to convert it); not a MINC file; time or vectors; sheared directions. DATA_LOSS: as
// OpenWalled.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenMincSeries(const std::string& path,
                                                             const std::string& field);

// The same in this process, which the libraries may end.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenMincFile(const std::string& path,
                                                           const std::string& part);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_MINC_SOURCE_H_
