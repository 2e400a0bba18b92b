// Datasets of an HDF5 file: which there are, of which type and shape. Calls the library: for the
// process that it runs in (walled_source.h).

#ifndef ISOSCOPE_CORE_SOURCE_HDF5_DATASET_H_
#define ISOSCOPE_CORE_SOURCE_HDF5_DATASET_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/axis_order.h"
#include "core/source/hdf5_handle.h"
#include "core/source/hdf5_source.h"
#include "core/source/volume_source.h"
#include "core/source/wide_source.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

// How samples are read: as they are stored, in little-endian order.
struct Hdf5SampleType {
  volume::ScalarType scalar = volume::ScalarType::kUint8;  // of `wide`, its carrier
  std::optional<WideType> wide;
  Hdf5Handle memory_type;
};

enum class Hdf5Types {
  kOfVolumes,  // integers of 8 to 32 bits; IEEE floats of 32 and 64
  kAll,        // those, integers of 64 bits, IEEE floats of 16, and h5py's bool as uint8
};

// INVALID_ARGUMENT: of no such type; the message is to follow the dataset's name and a colon.
absl::StatusOr<Hdf5SampleType> Hdf5SampleTypeOf(hid_t dataset, Hdf5Types types);

// Elements on each axis, slowest first; none if that is not known.
std::vector<std::int64_t> Hdf5DimsOf(hid_t dataset);

// A dataset and the file that holds it.
struct NamedHdf5Dataset {
  Hdf5Path parts;  // with the dataset's name, whether it was given or not
  Hdf5Handle file;
  Hdf5Handle dataset;
};

// Opens the dataset that the path names, or the only one that is a volume (three axes of more than
// one element, kOfVolumes). With `axes` above 0, without a name: the only one with so many axes,
// kAll. With kAll and no axes, if none is a volume: the only one of 3 axes or more.
// NOT_FOUND: no such file or dataset. INVALID_ARGUMENT: no HDF5 file; none named, and not one. All
// list the datasets that there are.
absl::StatusOr<NamedHdf5Dataset> OpenHdf5ByName(const std::string& path, Hdf5Types types,
                                                std::size_t axes = 0);

// Opens the volume at one step and one component of a dataset, in this process. Chunks as
// OpenHdf5Dataset. `samples`: the first samples of the dataset, not all. INVALID_ARGUMENT: no grid
// of a volume; chunks that are too large.
// REQUIRES: the axes are those of the dataset; indices in range, 0 where there is no such axis.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenHdf5Volume(
    NamedHdf5Dataset named, Hdf5SampleType type, const AxisOrder& axes, std::int64_t step,
    std::int64_t component, std::optional<math::Index3> samples = std::nullopt);

// "it holds /a, /b".
std::string ListHdf5Volumes(hid_t file);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_HDF5_DATASET_H_
