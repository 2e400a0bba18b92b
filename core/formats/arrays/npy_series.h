// NumPy arrays as volumes: one (.npy), or those of an archive (.npz).

#ifndef ISOSCOPE_CORE_FORMATS_ARRAYS_NPY_SERIES_H_
#define ISOSCOPE_CORE_FORMATS_ARRAYS_NPY_SERIES_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/volume_series.h"

namespace isoscope::source {

// Returns true if the beginning of a file, decoded, is of an array, or of an archive whose first
// member is one.
bool IsNpy(absl::string_view head);
bool IsNpz(absl::string_view head);

// Opens an array, plain or in a gzip stream, as one field of that name. `axes`: letters of --axes,
// by which an array of four axes has steps or components (NpyVolumesOf); "": three axes.
// INVALID_ARGUMENT: as ParseNpyHeader, NpyGrid, NpyVolumesOf, MakeLayoutSeries; the file is too
// short.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenNpySeries(const std::string& path,
                                                            const std::string& field,
                                                            const std::string& axes = "");

// Opens an archive of arrays, stored or deflated. Its members are fields: "a.npy" is a. Without a
// part they are all volumes that have the grid of the first one; those of other grids are
// fields_elsewhere, and other members are left out. A part names one. Its bytes are checked by the
// archive's checksum as the last one is read. NOT_FOUND: no such member (lists those there are).
// INVALID_ARGUMENT: as ReadZipMembers; no member that is a volume, with the reason of the first; a
// member whose size is not that of its array.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenNpzSeries(const std::string& path,
                                                            const std::string& part);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_ARRAYS_NPY_SERIES_H_
