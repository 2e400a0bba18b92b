#include "core/formats/hdf5/hdf5_mesh.h"

#include <array>

#include "core/base/status_macros.h"
#include "hdf5.h"

namespace isoscope::source {

std::vector<double> Hdf5Numbers(hid_t object, const char* attribute) {
  constexpr hssize_t kMaxNumbers = 64;
  if (H5Aexists(object, attribute) <= 0) {
    return {};
  }
  const Hdf5Handle opened(H5Aopen(object, attribute, H5P_DEFAULT), H5Aclose);
  const Hdf5Handle space(H5Aget_space(opened.get()), H5Sclose);
  const Hdf5Handle stored(H5Aget_type(opened.get()), H5Tclose);
  const H5T_class_t kind = H5Tget_class(stored.get());
  const hssize_t count = H5Sget_simple_extent_npoints(space.get());
  if ((kind != H5T_INTEGER && kind != H5T_FLOAT) || count < 1 || count > kMaxNumbers) {
    return {};
  }
  std::vector<double> numbers(static_cast<std::size_t>(count));
  return H5Aread(opened.get(), H5T_NATIVE_DOUBLE, numbers.data()) < 0 ? std::vector<double>()
                                                                      : numbers;
}

std::vector<std::string> Hdf5NamesIn(hid_t group) {
  constexpr hsize_t kMaxNames = 4096;
  H5G_info_t info{};
  std::vector<std::string> names;
  if (group < 0 || H5Gget_info(group, &info) < 0) {
    return names;
  }
  for (hsize_t i = 0; i < info.nlinks && i < kMaxNames; ++i) {
    std::array<char, 1024> name{};
    if (H5Lget_name_by_idx(group, ".", H5_INDEX_NAME, H5_ITER_INC, i, name.data(), name.size() - 1,
                           H5P_DEFAULT) > 0) {
      names.emplace_back(name.data());
    }
  }
  return names;
}

absl::StatusOr<std::optional<Hdf5MeshFile>> FindHdf5Meshes(hid_t file) {
  if (H5Lexists(file, "VTKHDF", H5P_DEFAULT) > 0) {
    const Hdf5Handle root(H5Gopen2(file, "VTKHDF", H5P_DEFAULT), H5Gclose);
    ISOSCOPE_ASSIGN_OR_RETURN(Hdf5MeshFile meshes, FindVtkHdfImage(root.get()));
    return meshes;
  }
  if (H5Aexists(file, "openPMD") > 0) {
    ISOSCOPE_ASSIGN_OR_RETURN(Hdf5MeshFile meshes, FindOpenPmdMeshes(file));
    return meshes;
  }
  if (IsImaris(file)) {
    ISOSCOPE_ASSIGN_OR_RETURN(Hdf5MeshFile meshes, FindImarisImage(file));
    return meshes;
  }
  if (IsItkHdf(file)) {
    ISOSCOPE_ASSIGN_OR_RETURN(Hdf5MeshFile meshes, FindItkHdfImage(file));
    return meshes;
  }
  return std::nullopt;
}

}  // namespace isoscope::source
