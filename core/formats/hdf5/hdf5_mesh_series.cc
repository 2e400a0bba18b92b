// The library runs in a child process, which answers three questions of the parent:
//
// 1. DescribeMeshes: which fields lie on the chosen grid? Without a part it is the grid of the most
//    fields. Each field has a number, its place in FindHdf5Meshes.
// 2. OpenMesh: the samples of the part "number step component rules". The child finds the meshes
//    again, and the file may have changed meanwhile. So numbers and sizes are checked anew.
// 3. DescribeMeshChunks: where do the chunks of such a part lie (hdf5_chunk_table.h)?
//
// A volume is a dataset, or a constant component of openPMD: a group with a value and a shape.
// Sources: the VTKHDF file format, https://docs.vtk.org; the openPMD standard, "Mesh Based
// Records", https://github.com/openPMD/openPMD-standard.

#include "core/formats/hdf5/hdf5_mesh_series.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/formats/hdf5/hdf5_boxes.h"
#include "core/formats/hdf5/hdf5_chunk_table.h"
#include "core/formats/hdf5/hdf5_dataset.h"
#include "core/formats/hdf5/hdf5_mesh.h"
#include "core/formats/hdf5/hdf5_storage.h"
#include "core/formats/hdf5/hdf5_types.h"
#include "core/source/child/walled_series.h"
#include "core/source/grid/grid_faults.h"
#include "core/source/hdf5/hdf5_far_file.h"
#include "core/source/hdf5/hdf5_file.h"
#include "core/source/series_parts.h"
#include "hdf5.h"

namespace isoscope::source {
namespace {

// Samples of one value.
class ConstantSource final : public VolumeSource {
 public:
  ConstantSource(const std::string& name, const Hdf5Constant& constant,
                 const volume::GridGeometry& geometry)
      : VolumeSource({.name = name,
                      .geometry = geometry,
                      .type = constant.is_single ? volume::ScalarType::kFloat32
                                                 : volume::ScalarType::kFloat64}),
        constant_(constant) {}

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const std::int64_t count = (end_row - begin_row) * info().geometry.sample_dims.x;
    const auto single = static_cast<float>(constant_.value);
    for (std::int64_t i = 0; i < count; ++i) {
      if (constant_.is_single) {
        std::memcpy(out + i * 4, &single, 4);
      } else {
        std::memcpy(out + i * 8, &constant_.value, 8);
      }
    }
    return absl::OkStatus();
  }

 private:
  const Hdf5Constant constant_;
};

absl::Status WithName(const std::string& name, const absl::Status& status) {
  return absl::Status(status.code(), absl::StrCat(name, ": ", status.message()));
}

absl::StatusOr<std::optional<Hdf5MeshFile>> FindMeshesOf(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Hdf5Handle file, OpenHdf5File(path));
  auto meshes = FindHdf5Meshes(file.get());
  if (!meshes.ok()) {
    return WithName(path, meshes.status());
  }
  return meshes;
}

// INVALID_ARGUMENT unless the volumes of a field from `begin` to `end` say the same as those of its
// first step.
absl::Status CheckSteps(const std::string& path, const Hdf5MeshField& field, std::size_t begin,
                        std::size_t end) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Hdf5Handle file, OpenHdf5File(path));
  const absl::Status same = CheckOpenPmdSteps(file.get(), path, field, begin, end);
  return same.ok() ? same : WithName(path, same);
}

absl::StatusOr<std::vector<std::string>> DescribeMeshes(const std::string& path,
                                                        const std::string& part) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::optional<Hdf5MeshFile> meshes, FindMeshesOf(path));
  if (!meshes.has_value()) {
    return std::vector<std::string>();
  }
  // Whoever opens a volume gets the faults of its grid. NaN would not equal itself.
  for (Hdf5MeshField& field : meshes->fields) {
    GridFaults faults;
    ReplaceFaults("", &field.geometry, &faults);
  }
  const Hdf5MeshField* chosen = nullptr;
  std::ptrdiff_t most = 0;
  for (const Hdf5MeshField& candidate : meshes->fields) {
    const std::string& name = candidate.field.name;
    if (name == part || absl::StartsWith(part, absl::StrCat(name, ":"))) {
      chosen = &candidate;
      break;
    }
    const auto alike = std::count_if(
        meshes->fields.begin(), meshes->fields.end(),
        [&](const Hdf5MeshField& other) { return other.geometry == candidate.geometry; });
    if (alike > most) {
      chosen = &candidate;
      most = alike;
    }
  }
  WalledFile file{.info = meshes->info};
  for (std::size_t i = 0; i < meshes->fields.size(); ++i) {
    const Hdf5MeshField& field = meshes->fields[i];
    if (field.geometry == chosen->geometry) {
      if (part.empty() || &field == chosen) {
        ISOSCOPE_RETURN_IF_ERROR(CheckSteps(path, field, 0, field.volumes.size()));
      }
      file.Add(field.field, static_cast<std::int64_t>(i));
    }
  }
  return WalledTexts(file);
}

// INVALID_ARGUMENT unless a dataset of these sizes has the samples of the field's grid.
absl::Status CheckSamples(const Hdf5MeshField& field, const AxisOrder& axes,
                          const std::vector<std::int64_t>& dims) {
  const math::Index3& samples = field.geometry.sample_dims;
  const auto fits = [&](std::size_t axis, std::int64_t size) {
    return dims[axis] == size || (field.is_filled_up && dims[axis] > size);
  };
  if (dims.size() <= axes.x || !fits(axes.z, samples.z) || !fits(axes.y, samples.y) ||
      !fits(axes.x, samples.x)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "it has not the %d x %d x %d samples of the first step: all steps must lie on one grid",
        samples.z, samples.y, samples.x));
  }
  return volume::Validate(field.geometry);
}

// The constant that a volume is; not set if it is a dataset.
std::optional<Hdf5Constant> FindConstantOf(const std::string& path, const Hdf5MeshVolume& volume) {
  const Hdf5Handle file = OpenHdf5ToRead(path);
  const Hdf5Handle object(H5Oopen(file.get(), volume.dataset.c_str(), H5P_DEFAULT), H5Oclose);
  return FindHdf5Constant(object.get());
}

// A volume of the meshes: a constant, or a dataset.
struct FoundMesh {
  Hdf5MeshField field;
  Hdf5MeshVolume volume;
  std::string name{};
  std::optional<Hdf5Constant> constant{};
  NamedHdf5Dataset named{};
  Hdf5SampleType type{};
};

absl::StatusOr<FoundMesh> FindMesh(const std::string& path, const std::string& part) {
  const auto [number, step, component] = ParseWalledPart(part);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::optional<Hdf5MeshFile> meshes, FindMeshesOf(path));
  if (!meshes.has_value() || number >= static_cast<std::int64_t>(meshes->fields.size())) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": its meshes have changed"));
  }
  Hdf5MeshField field = meshes->fields[static_cast<std::size_t>(number)];
  ISOSCOPE_RETURN_IF_ERROR(TakeGridByRules(path, GivenRules(part), &field.geometry));
  const auto components = static_cast<std::int64_t>(field.field.components.size());
  const std::int64_t index = step * components + component;
  if (component >= components || index >= static_cast<std::int64_t>(field.volumes.size())) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": its meshes have changed"));
  }
  const auto at = static_cast<std::size_t>(index);
  ISOSCOPE_RETURN_IF_ERROR(CheckSteps(path, field, at, at + 1));
  const Hdf5MeshVolume& wanted = field.volumes[at];
  FoundMesh found{.field = field,
                  .volume = wanted,
                  .name = absl::StrCat(path, ":", wanted.dataset),
                  .constant = FindConstantOf(path, wanted)};
  if (found.constant.has_value()) {
    const absl::Status valid = CheckSamples(field, wanted.axes, found.constant->dims);
    if (!valid.ok()) {
      return WithName(found.name, valid);
    }
    return found;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(found.named, OpenHdf5ByName(found.name));
  found.name = found.named.parts.name();
  ISOSCOPE_RETURN_IF_ERROR(FindHdf5Files(found.named.dataset.get(), found.name).status());
  auto type = Hdf5SampleTypeOf(found.named.dataset.get());
  const absl::Status valid =
      type.ok() ? CheckSamples(field, wanted.axes, Hdf5DimsOf(found.named.dataset.get()))
                : type.status();
  if (!valid.ok()) {
    return WithName(found.name, valid);
  }
  found.type = *std::move(type);
  return found;
}

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenMesh(const std::string& path,
                                                       const std::string& part) {
  ISOSCOPE_ASSIGN_OR_RETURN(FoundMesh found, FindMesh(path, part));
  if (found.constant.has_value()) {
    return std::make_unique<ConstantSource>(found.name, *found.constant, found.field.geometry);
  }
  return OpenHdf5Volume(std::move(found.named), std::move(found.type), found.volume.axes,
                        found.volume.step, found.volume.component, found.field.geometry);
}

// The chunks of a part, from the number on that is its last word; nothing of a constant.
absl::StatusOr<std::vector<std::string>> DescribeMeshChunks(const std::string& path,
                                                            const std::string& part) {
  const std::size_t blank = part.rfind(' ');
  std::int64_t first = 0;
  ISOSCOPE_CHECK(absl::SimpleAtoi(part.substr(blank + 1), &first));
  ISOSCOPE_ASSIGN_OR_RETURN(const FoundMesh found, FindMesh(path, part.substr(0, blank)));
  if (found.constant.has_value()) {
    return std::vector<std::string>();
  }
  return ListHdf5Chunks(found.named, found.type, found.volume.axes, found.volume.step,
                        found.volume.component, first);
}

constexpr WalledLibrary kHdf5Meshes = {
    .name = "HDF5", .open = OpenMesh, .find_files = nullptr, .describe = DescribeMeshes};
constexpr WalledLibrary kHdf5MeshChunks = {
    .name = "HDF5", .open = OpenMesh, .find_files = nullptr, .describe = DescribeMeshChunks};

std::unique_ptr<VolumeSource> WithMeshBoxes(std::unique_ptr<VolumeSource> volume,
                                            const std::string& file, const std::string& part) {
  return WithHdf5Boxes(std::move(volume), kHdf5MeshChunks, file, part);
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenHdf5MeshSeries(const std::string& file,
                                                                 const std::string& part,
                                                                 const GridRules& rules) {
  const GridRules given{.has_spacing = rules.has_spacing,
                        .has_origin = rules.has_origin,
                        .has_direction = rules.has_direction};
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSeries> series,
                            OpenWalledSeries(kHdf5Meshes, file, part, given, WithMeshBoxes));
  return series == nullptr || part.empty() ? std::move(series)
                                           : SelectPart(std::move(series), file, part);
}

}  // namespace isoscope::source
