// HDF5 files that describe their own meshes: VTKHDF images, openPMD, Imaris and ITK. Calls the
// library: for the process that it runs in (walled_source.h).

#ifndef ISOSCOPE_CORE_FORMATS_HDF5_HDF5_MESH_H_
#define ISOSCOPE_CORE_FORMATS_HDF5_HDF5_MESH_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/source/grid/axis_order.h"
#include "core/source/hdf5/hdf5_handle.h"
#include "core/source/volume_series.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {

// A volume of a dataset, or of a constant (Hdf5Constant).
struct Hdf5MeshVolume {
  std::string dataset;
  AxisOrder axes;
  std::int64_t step = 0;       // on the axis t, if there is one
  std::int64_t component = 0;  // on the axis c, if there is one
  std::string record{};        // of openPMD: the object with the attributes of the grid
};

struct Hdf5MeshField {
  SourceField field;
  volume::GridGeometry geometry;
  // The volumes by step and component, the component faster.
  std::vector<Hdf5MeshVolume> volumes{};
  bool is_filled_up = false;  // datasets may have more samples behind those of the grid
};

struct Hdf5MeshFile {
  std::vector<Hdf5MeshField> fields{};  // on any grids
  SeriesInfo info{};                    // but its name and fields
};

// A constant component of openPMD: a group that says its samples by their value and number.
struct Hdf5Constant {
  double value = 0;
  bool is_single = false;          // a float of 32 bits
  std::vector<std::int64_t> dims;  // slowest first
};
// Not set if the object is not such a group, or its shape has numbers that are no sizes.
std::optional<Hdf5Constant> FindHdf5Constant(hid_t object);

// Not set if the file describes no meshes. Errors are without the file's name. INVALID_ARGUMENT: a
// VTKHDF file of another Type than ImageData; no mesh in space; times that do not ascend; more than
// 100 000 steps or 4096 fields; sizes that contradict each other.
absl::StatusOr<std::optional<Hdf5MeshFile>> FindHdf5Meshes(hid_t file);

// The numbers of an attribute, 64 at most; none if there is no such attribute of numbers.
std::vector<double> Hdf5Numbers(hid_t object, const char* attribute);
// The names in a group, in ascending order, 4096 at most; none if it is no group.
std::vector<std::string> Hdf5NamesIn(hid_t group);

// The kinds (vtk_hdf_image.cc, openpmd_meshes.cc, imaris_image.cc, itk_hdf_image.cc), of the group
// VTKHDF and the root.
absl::StatusOr<Hdf5MeshFile> FindVtkHdfImage(hid_t root);
// The grid and the unit of a field are those of the first iteration.
absl::StatusOr<Hdf5MeshFile> FindOpenPmdMeshes(hid_t file);
// Checks that the volumes of a field from `begin` to `end` have the grid and the unit of those of
// the first step. Missing ones are passed over. OK for fields of other kinds.
// INVALID_ARGUMENT: says the attribute with both values. `path` is that of the file, for advice.
absl::Status CheckOpenPmdSteps(hid_t file, const std::string& path, const Hdf5MeshField& field,
                               std::size_t begin, std::size_t end);
bool IsImaris(hid_t file);
absl::StatusOr<Hdf5MeshFile> FindImarisImage(hid_t file);
bool IsItkHdf(hid_t file);
absl::StatusOr<Hdf5MeshFile> FindItkHdfImage(hid_t file);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_HDF5_HDF5_MESH_H_
