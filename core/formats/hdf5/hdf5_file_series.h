// A series of HDF5 files that describe their meshes, one step a file, as simulation codes write
// openPMD ("fileBased").

#ifndef ISOSCOPE_CORE_FORMATS_HDF5_HDF5_FILE_SERIES_H_
#define ISOSCOPE_CORE_FORMATS_HDF5_HDF5_FILE_SERIES_H_

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/grid/grid_rules.h"
#include "core/source/hdf5/hdf5_path.h"
#include "core/source/volume_series.h"

namespace isoscope::source {

// Returns the files of a pattern, "data9.h5" before "data10.h5". A pattern has '*', '?' or '[' in
// it, or one mark of openPMD for the number of an iteration. %T stands for digits, %06T for six
// digits, or for more without zeros in front. Not set if `file` is no pattern, or exists.
// NOT_FOUND: no such file.
absl::StatusOr<std::optional<std::vector<std::string>>> FilesOfHdf5Pattern(const std::string& file);

// Opens files in ascending order of time, each as one step. The fields are all of theirs, or the
// one that `part` names, as in OpenHdf5MeshSeries. REQUIRES: at least one file. Files without times
// are numbered from 0. Fields, units and grid are those of the first file; further fields of others
// are passed over. No file stays open. `name` is the pattern, for messages.
//
// Every file is read at once, each in a child process, for its time, fields and grid.
// INVALID_ARGUMENT names a file that describes no meshes, has several steps, no later time than the
// one before, not a field of the first, or another unit, components or grid. Otherwise errors as
// OpenHdf5MeshSeries.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenHdf5FileSeries(
    const std::string& name, const std::vector<std::string>& files, const std::string& part,
    const GridRules& rules = {});

// Returns true if netCDF-4 wrote an HDF5 file, whatever its name: it says so, or numbers its
// dimensions. Asks a child process. Errors as OpenHdf5MeshSeries.
absl::StatusOr<bool> IsWrittenByNetcdf(const std::string& file);

// Opens the meshes of a file, or of the files of a pattern. Null if the file describes none, or if
// the path names a dataset of it ("/data/100/rho"). INVALID_ARGUMENT: a dataset of a pattern.
// Otherwise errors as above, and as OpenHdf5MeshSeries.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenHdf5Meshes(const Hdf5Path& path,
                                                             const GridRules& rules = {});

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_HDF5_HDF5_FILE_SERIES_H_
