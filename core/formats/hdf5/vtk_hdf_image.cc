// A VTKHDF file of an image:
//
//   /VTKHDF                     Type="ImageData", WholeExtent, Origin, Spacing, Direction
//     PointData/p               [z][y][x], or [z][y][x][c]
//     CellData/q                one less on each axis
//     Steps                     NSteps; then arrays have an axis in front, of time
//       Values                  [NSteps], the times
//       PointDataOffsets/p      [NSteps], the index on that axis by step; else the step itself
//
// Source: VTK's "VTKHDF File Format", https://docs.vtk.org, versions 1 and 2.

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/status_macros.h"
#include "core/formats/hdf5/hdf5_attributes.h"
#include "core/formats/hdf5/hdf5_dataset.h"
#include "core/formats/hdf5/hdf5_mesh.h"
#include "core/source/bytes/located_series.h"
#include "core/source/grid/vtk_extent.h"
#include "core/source/hdf5/hdf5_far_file.h"
#include "core/source/hdf5/hdf5_handle.h"
#include "core/source/series_parts.h"
#include "hdf5.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxVtkHdfSteps = 100'000;
constexpr std::int64_t kMaxVtkHdfComponents = 4096;

struct VtkHdfGrid {
  VtkExtent extent{};
  VtkAttributes image{};
};

absl::StatusOr<VtkHdfGrid> ReadVtkHdfGrid(hid_t root) {
  const std::string type = Hdf5Text(root, {"Type"});
  if (type != "ImageData") {
    return absl::InvalidArgumentError(absl::StrFormat(
        "a VTKHDF file of Type \"%s\"; expected ImageData, samples at even distances: resample it, "
        "as ParaView's filter \"Resample To Image\" does",
        type));
  }
  const auto text = [&](const char* name) {
    return absl::StrJoin(Hdf5Numbers(root, name), " ", [](std::string* out, double number) {
      absl::StrAppendFormat(out, "%.17g", number);
    });
  };
  VtkHdfGrid grid;
  ISOSCOPE_ASSIGN_OR_RETURN(grid.extent,
                            ParseVtkExtent(text("WholeExtent"), "WholeExtent", "VTKHDF"));
  for (const char* name : {"Origin", "Spacing", "Direction"}) {
    if (H5Aexists(root, name) > 0) {
      grid.image[name] = text(name);
    }
  }
  return grid;
}

// The times; none if the file has no steps.
absl::StatusOr<std::vector<double>> ReadVtkHdfTimes(hid_t root) {
  if (H5Lexists(root, "Steps", H5P_DEFAULT) <= 0) {
    return std::vector<double>();
  }
  const Hdf5Handle steps(H5Gopen2(root, "Steps", H5P_DEFAULT), H5Gclose);
  const std::vector<double> count = Hdf5Numbers(steps.get(), "NSteps");
  if (count.size() != 1 || !(count[0] >= 1) || count[0] > static_cast<double>(kMaxVtkHdfSteps)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("its Steps have no NSteps from 1 to %d", kMaxVtkHdfSteps));
  }
  const Hdf5Handle values(H5Dopen2(steps.get(), "Values", H5P_DEFAULT), H5Dclose);
  if (!values.is_valid()) {
    return absl::InvalidArgumentError("its Steps have no Values");
  }
  return Hdf5ScaleValues(values.get(), static_cast<std::int64_t>(count[0]));
}

// Returns the index of each step on the axis of time. Without such a dataset it is the step itself.
absl::StatusOr<std::vector<std::int64_t>> ReadVtkHdfOffsets(hid_t root, const std::string& path,
                                                            std::size_t step_count) {
  std::vector<std::int64_t> offsets(step_count);
  for (std::size_t i = 0; i < step_count; ++i) {
    offsets[i] = static_cast<std::int64_t>(i);
  }
  const std::string folder = path.substr(0, path.rfind('/'));
  if (H5Lexists(root, folder.c_str(), H5P_DEFAULT) <= 0 ||
      H5Lexists(root, path.c_str(), H5P_DEFAULT) <= 0) {
    return offsets;
  }
  const auto count = static_cast<std::int64_t>(step_count);
  const Hdf5Handle dataset(H5Dopen2(root, path.c_str(), H5P_DEFAULT), H5Dclose);
  const std::vector<std::int64_t> dims =
      dataset.is_valid() ? Hdf5DimsOf(dataset.get()) : std::vector<std::int64_t>();
  // The numbers of one array, or of one part, as VTK writes it for partitioned data.
  if (dims != std::vector<std::int64_t>{count} && dims != std::vector<std::int64_t>{count, 1}) {
    return absl::InvalidArgumentError(
        absl::StrFormat("its %s has %s numbers; expected one a step, %d: correct it, or remove it "
                        "where step i is number i of the array",
                        path, dims.empty() ? "no" : absl::StrJoin(dims, " x "), count));
  }
  if (ReadWholeHdf5(dataset.get(), H5T_NATIVE_INT64, offsets.data()) < 0) {
    return absl::DataLossError(absl::StrFormat("its %s can't be read: %s", path, LastHdf5Error()));
  }
  return offsets;
}

// The arrays of PointData, or of CellData.
struct VtkHdfPart {
  std::string group;
  bool is_of_cells = false;
  volume::GridGeometry geometry{};
  std::size_t step_count = 0;  // 0: no axis of time
};

// The field of one array of a part.
absl::StatusOr<Hdf5MeshField> VtkHdfFieldOf(hid_t root, const VtkHdfPart& part,
                                            const std::string& name, hid_t dataset) {
  const std::vector<std::int64_t> dims = Hdf5DimsOf(dataset);
  const math::Index3& samples = part.geometry.sample_dims;
  const std::size_t time_axes = part.step_count > 0 ? 1 : 0;
  const std::size_t rank = dims.size();
  if ((rank != 3 + time_axes && rank != 4 + time_axes) || dims[time_axes] != samples.z ||
      dims[time_axes + 1] != samples.y || dims[time_axes + 2] != samples.x ||
      (rank == 4 + time_axes && (dims.back() < 1 || dims.back() > kMaxVtkHdfComponents))) {
    return absl::InvalidArgumentError(
        absl::StrFormat("array %s/%s has %s elements; its WholeExtent needs %s%d x %d x %d",
                        part.group, name, absl::StrJoin(dims, " x "),
                        time_axes > 0 ? "steps x " : "", samples.z, samples.y, samples.x));
  }
  const std::int64_t components = rank == 4 + time_axes ? dims.back() : 1;
  Hdf5MeshField field{
      .field = {.name = name,
                .long_name =
                    part.is_of_cells ? absl::StrCat(name, " (of cells, at their centres)") : "",
                .unit = Hdf5Text(dataset, {"units", "UNITS_LABEL"}),
                .components = ComponentNames(components)},
      .geometry = part.geometry};
  AxisOrder axes{.z = time_axes, .y = time_axes + 1, .x = time_axes + 2};
  std::vector<std::int64_t> offsets{0};
  if (time_axes > 0) {
    axes.t = 0;
    ISOSCOPE_ASSIGN_OR_RETURN(
        offsets, ReadVtkHdfOffsets(root, absl::StrCat("Steps/", part.group, "Offsets/", name),
                                   part.step_count));
  }
  if (rank == 4 + time_axes) {
    axes.c = rank - 1;
  }
  for (const std::int64_t offset : offsets) {
    if (time_axes > 0 && (offset < 0 || offset >= dims[0])) {
      return absl::InvalidArgumentError(
          absl::StrFormat("array %s/%s has %d steps; a step is said to be number %d", part.group,
                          name, dims[0], offset));
    }
    for (std::int64_t component = 0; component < components; ++component) {
      field.volumes.push_back({.dataset = absl::StrCat("/VTKHDF/", part.group, "/", name),
                               .axes = axes,
                               .step = offset,
                               .component = component});
    }
  }
  return field;
}

// Adds the arrays of numbers in PointData or CellData.
absl::Status AddVtkHdfArrays(hid_t root, const VtkHdfGrid& grid, bool is_of_cells,
                             Hdf5MeshFile* meshes) {
  VtkHdfPart part{.group = is_of_cells ? "CellData" : "PointData",
                  .is_of_cells = is_of_cells,
                  .step_count = meshes->info.times.size()};
  if (H5Lexists(root, part.group.c_str(), H5P_DEFAULT) <= 0) {
    return absl::OkStatus();
  }
  const Hdf5Handle group(H5Gopen2(root, part.group.c_str(), H5P_DEFAULT), H5Gclose);
  ISOSCOPE_ASSIGN_OR_RETURN(part.geometry,
                            VtkGridOf(grid.image, grid.extent, is_of_cells, "VTKHDF"));
  for (const std::string& name : Hdf5NamesIn(group.get())) {
    const Hdf5Handle dataset(H5Dopen2(group.get(), name.c_str(), H5P_DEFAULT), H5Dclose);
    if (!dataset.is_valid() || name == "vtkGhostType" || !Hdf5SampleTypeOf(dataset.get()).ok()) {
      continue;
    }
    ISOSCOPE_ASSIGN_OR_RETURN(Hdf5MeshField field, VtkHdfFieldOf(root, part, name, dataset.get()));
    meshes->fields.push_back(std::move(field));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<Hdf5MeshFile> FindVtkHdfImage(hid_t root) {
  ISOSCOPE_ASSIGN_OR_RETURN(const VtkHdfGrid grid, ReadVtkHdfGrid(root));
  Hdf5MeshFile meshes;
  ISOSCOPE_ASSIGN_OR_RETURN(meshes.info.times, ReadVtkHdfTimes(root));
  for (const bool is_of_cells : {false, true}) {
    if (meshes.fields.empty()) {
      ISOSCOPE_RETURN_IF_ERROR(AddVtkHdfArrays(root, grid, is_of_cells, &meshes));
    }
  }
  if (meshes.fields.empty()) {
    return absl::InvalidArgumentError("a VTKHDF file without an array of numbers");
  }
  return meshes;
}

}  // namespace isoscope::source
