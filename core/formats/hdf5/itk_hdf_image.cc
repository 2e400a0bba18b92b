// An image that ITK wrote as HDF5:
//
//   /ITKImage/0
//     Dimension, Origin, Spacing   [axis], x first
//     Directions                   [axis][world]
//     VoxelData                    [z][y][x], or [z][y][x][c]
//     VoxelType, MetaData          passed over
//
// Source: ITK 5.2, itk::HDF5ImageIO.

#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/status_macros.h"
#include "core/formats/hdf5/hdf5_dataset.h"
#include "core/formats/hdf5/hdf5_mesh.h"
#include "core/source/bytes/located_series.h"
#include "core/source/hdf5/hdf5_far_file.h"
#include "core/source/series_parts.h"
#include "hdf5.h"

namespace isoscope::source {
namespace {

constexpr char kItkGroup[] = "/ITKImage/0";
constexpr std::int64_t kMaxItkComponents = 4096;

// All elements of a dataset, N of them. INVALID_ARGUMENT.
template <std::size_t N>
absl::StatusOr<std::array<double, N>> ReadItkNumbers(hid_t image, const char* name) {
  const Hdf5Handle dataset(H5Dopen2(image, name, H5P_DEFAULT), H5Dclose);
  std::int64_t count = dataset.is_valid() ? 1 : 0;
  for (const std::int64_t size :
       dataset.is_valid() ? Hdf5DimsOf(dataset.get()) : std::vector<std::int64_t>()) {
    // A product of sizes of a hostile file must not overflow.
    count = size > static_cast<std::int64_t>(N) ? 0 : count * size;
  }
  std::array<double, N> numbers{};
  if (count != static_cast<std::int64_t>(N) ||
      ReadWholeHdf5(dataset.get(), H5T_NATIVE_DOUBLE, numbers.data()) < 0) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "an ITK image whose %s/%s has not the %d numbers of a volume", kItkGroup, name, N));
  }
  return numbers;
}

absl::StatusOr<volume::GridGeometry> ItkHdfGrid(hid_t image) {
  ISOSCOPE_ASSIGN_OR_RETURN(const auto origin, ReadItkNumbers<3>(image, "Origin"));
  ISOSCOPE_ASSIGN_OR_RETURN(const auto spacing, ReadItkNumbers<3>(image, "Spacing"));
  ISOSCOPE_ASSIGN_OR_RETURN(const auto directions, ReadItkNumbers<9>(image, "Directions"));
  volume::GridGeometry grid;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const int i = static_cast<int>(axis);
    grid.origin[i] = origin.at(axis);
    grid.spacing[i] = spacing.at(axis);
    grid.direction.columns.at(axis) = {directions.at(3 * axis), directions.at(3 * axis + 1),
                                       directions.at(3 * axis + 2)};
  }
  return grid;
}

}  // namespace

bool IsItkHdf(hid_t file) {
  return H5Lexists(file, "ITKImage", H5P_DEFAULT) > 0 &&
         H5Lexists(file, kItkGroup, H5P_DEFAULT) > 0;
}

absl::StatusOr<Hdf5MeshFile> FindItkHdfImage(hid_t file) {
  const Hdf5Handle image(H5Gopen2(file, kItkGroup, H5P_DEFAULT), H5Gclose);
  const Hdf5Handle data(H5Dopen2(image.get(), "VoxelData", H5P_DEFAULT), H5Dclose);
  const std::vector<std::int64_t> dims =
      data.is_valid() ? Hdf5DimsOf(data.get()) : std::vector<std::int64_t>();
  const bool has_components = dims.size() == 4;
  const std::int64_t components = has_components ? dims[3] : 1;
  if ((dims.size() != 3 && !has_components) || components < 1 || components > kMaxItkComponents) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "an ITK image whose %s/VoxelData has %d axes (%s elements); expected z, y and x, or these "
        "and 1 to %d components",
        kItkGroup, dims.size(), absl::StrJoin(dims, " x "), kMaxItkComponents));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(volume::GridGeometry grid, ItkHdfGrid(image.get()));
  grid.sample_dims = {dims[2], dims[1], dims[0]};
  AxisOrder axes{.z = 0, .y = 1, .x = 2};
  if (has_components) {
    axes.c = 3;
  }
  Hdf5MeshField field{.field = {.name = "image", .components = ComponentNames(components)},
                      .geometry = grid};
  for (std::int64_t component = 0; component < components; ++component) {
    field.volumes.push_back(
        {.dataset = "/ITKImage/0/VoxelData", .axes = axes, .component = component});
  }
  Hdf5MeshFile meshes;
  meshes.fields.push_back(std::move(field));
  return meshes;
}

}  // namespace isoscope::source
