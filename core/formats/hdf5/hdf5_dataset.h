// Datasets of an HDF5 file: which one a path means, and its shape. Calls the library: for the
// process that it runs in (walled_source.h).

#ifndef ISOSCOPE_CORE_FORMATS_HDF5_HDF5_DATASET_H_
#define ISOSCOPE_CORE_FORMATS_HDF5_HDF5_DATASET_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/formats/hdf5/hdf5_types.h"
#include "core/source/grid/axis_order.h"
#include "core/source/hdf5/hdf5_handle.h"
#include "core/source/hdf5/hdf5_path.h"
#include "core/source/volume_source.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {

// Elements on each axis, slowest first; none if that is not known.
std::vector<std::int64_t> Hdf5DimsOf(hid_t dataset);

// A dataset and the file that holds it.
struct NamedHdf5Dataset {
  Hdf5Path parts;  // with the dataset's name, whether it was given or not
  Hdf5Handle file;
  Hdf5Handle dataset;
};

// Opens the dataset that the path names; a group that is a plot of NeXus means its signal. Without
// a name: the plot that a NeXus file has by default (nexus_data.h), if it is a volume; else the
// only volume of plain numbers (IsPlainHdf5Type; three axes of more than one element); else the
// only dataset of samples of three axes or more. With `axes` above 0, without a name: the only one
// with so many axes. NOT_FOUND: no such file or dataset. INVALID_ARGUMENT: none named, and not one;
// a filter is not installed. All list the datasets that there are. Otherwise errors as
// OpenHdf5File.
absl::StatusOr<NamedHdf5Dataset> OpenHdf5ByName(const std::string& path, std::size_t axes = 0);

// Opens the volume at one step and one component of a dataset, in this process. The chunks of a
// layer are kept (hdf5_source.cc). `geometry` may have fewer samples than the dataset: the first
// ones. INVALID_ARGUMENT: no grid of a volume; chunks that are too large. REQUIRES: the axes are
// those of the dataset; indices in range, 0 where there is no such axis.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenHdf5Volume(
    NamedHdf5Dataset named, Hdf5SampleType type, const AxisOrder& axes, std::int64_t step,
    std::int64_t component, const volume::GridGeometry& geometry);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_HDF5_HDF5_DATASET_H_
