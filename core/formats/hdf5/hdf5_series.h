// The steps and components of a dataset of an HDF5 file.

#ifndef ISOSCOPE_CORE_FORMATS_HDF5_HDF5_SERIES_H_
#define ISOSCOPE_CORE_FORMATS_HDF5_HDF5_SERIES_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/grid/grid_rules.h"
#include "core/source/volume_series.h"

namespace isoscope::source {

// Opens a dataset of three axes or more as one field, with the dataset's name, its "long_name" and
// "units". Which one a path means, and of which types: hdf5_dataset.h, hdf5_types.h; integers of 64
// bits and floats of 16 become other ones (wide_source.h). `axes` are letters ("TCZYX", slowest
// first) for the meaning of its axes; "": what the file says. Axes, positions and uneven grids:
// hdf5_coordinates.h; the rules say whether a grid that is not even is resampled. Times are the
// coordinates of the time axis; without any 0, 1, 2, ...
//
// Errors as OpenHdf5ByName, Hdf5AxesOf, Hdf5LayoutOf and FindHdf5Files; those of opening a volume
// as Hdf5GridOf and ResampleSource. INVALID_ARGUMENT also: other types; a time axis of more than
// 100 000; times that do not ascend; chunks that are too large. The library runs in a child
// process, one for each open volume.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenHdf5Series(const std::string& path,
                                                             const std::string& axes,
                                                             const GridRules& rules = {});

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_HDF5_HDF5_SERIES_H_
