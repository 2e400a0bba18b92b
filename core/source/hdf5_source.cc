// A path names a file and a dataset in it, "run.h5:/fields/density". A dataset is an array of any
// number of axes, slowest first: [z][y][x]. The library reads boxes of it ("hyperslabs") and
// converts type and byte order on the way. Opening one takes these steps:
//
//   1. The name is split. If it names no dataset, the file must hold exactly one that is a volume.
//   2. All files of the dataset are located (hdf5_storage.h), because the library silently reads
//      fill values in place of a missing file.
//   3. Three axes are chosen: in (1, 93, 64, 1, 64) the axes 1, 2 and 4 are z, y and x.
//   4. For a dataset in chunks the cache is set to one layer of them, and the dataset opened again.
//
// The cache makes rows cheap. Chunks are compressed whole, and rows are read in ascending order, so
// a chunk of 32 x 32 x 32 samples is needed for 32 planes. A layer has all chunks of the same z. If
// it fits into the cache (32 MiB), it is decoded once; else it is decoded again for each run of
// rows.
//
// Rows [begin, end) are at most three boxes: the rest of a plane, whole planes, the start of a
// plane.
//
//   rows 30 to 170 of planes of 64 rows: rows 30-63 of plane 0, plane 1, rows 0-41 of plane 2

#include "core/source/hdf5_source.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/source/hdf5_handle.h"
#include "core/source/hdf5_storage.h"
#include "core/source/part_path.h"
#include "core/source/walled_source.h"
#include "hdf5.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxChunkCacheBytes = 32 * base::kMiB;
// The library's buffers for type conversion, beside the chunk cache.
constexpr std::int64_t kConversionBytes = 4 * base::kMiB;
// A larger chunk would not fit under a small memory limit.
constexpr std::int64_t kMaxChunkBytes = 256 * base::kMiB;

// The dimensions of a space of three axes or more; empty if it has fewer.
std::vector<hsize_t> VolumeDims(hid_t space) {
  const int rank = H5Sget_simple_extent_ndims(space);
  if (rank < 3 || rank > H5S_MAX_RANK) {
    return {};
  }
  std::vector<hsize_t> dims(static_cast<std::size_t>(rank));
  H5Sget_simple_extent_dims(space, dims.data(), nullptr);
  return dims;
}

// Finds the axes of the dataset that are z, y and x: those with more than one element if there are
// more than three. False if there are not three.
bool FindAxes(const std::vector<hsize_t>& dims, std::array<std::size_t, 3>* axes) {
  if (dims.size() < 3) {
    return false;
  }
  std::vector<std::size_t> wide;
  for (std::size_t axis = 0; axis < dims.size(); ++axis) {
    if (dims[axis] != 1) {
      wide.push_back(axis);
    }
  }
  if (dims.size() == 3) {
    *axes = {0, 1, 2};
    return true;
  }
  if (wide.size() != 3) {
    return false;
  }
  *axes = {wide[0], wide[1], wide[2]};
  return true;
}

bool ScalarTypeOf(hid_t type, volume::ScalarType* scalar) {
  const std::size_t size = H5Tget_size(type);
  const H5T_class_t kind = H5Tget_class(type);
  if (kind == H5T_FLOAT) {
    // Only IEEE types: the library's conversion of other formats depends on how much is read at
    // once.
    const bool is_single = H5Tequal(type, H5T_IEEE_F32LE) > 0 || H5Tequal(type, H5T_IEEE_F32BE) > 0;
    const bool is_double = H5Tequal(type, H5T_IEEE_F64LE) > 0 || H5Tequal(type, H5T_IEEE_F64BE) > 0;
    *scalar = is_single ? volume::ScalarType::kFloat32 : volume::ScalarType::kFloat64;
    return is_single || is_double;
  }
  if (kind != H5T_INTEGER) {
    return false;
  }
  const bool is_signed = H5Tget_sign(type) == H5T_SGN_2;
  switch (size) {
    case 1:
      *scalar = is_signed ? volume::ScalarType::kInt8 : volume::ScalarType::kUint8;
      return true;
    case 2:
      *scalar = is_signed ? volume::ScalarType::kInt16 : volume::ScalarType::kUint16;
      return true;
    case 4:
      *scalar = is_signed ? volume::ScalarType::kInt32 : volume::ScalarType::kUint32;
      return true;
    default:
      return false;
  }
}

hid_t MemoryTypeOf(volume::ScalarType type) {
  switch (type) {
    case volume::ScalarType::kUint8:
      return H5T_STD_U8LE;
    case volume::ScalarType::kInt8:
      return H5T_STD_I8LE;
    case volume::ScalarType::kUint16:
      return H5T_STD_U16LE;
    case volume::ScalarType::kInt16:
      return H5T_STD_I16LE;
    case volume::ScalarType::kUint32:
      return H5T_STD_U32LE;
    case volume::ScalarType::kInt32:
      return H5T_STD_I32LE;
    case volume::ScalarType::kFloat32:
      return H5T_IEEE_F32LE;
    case volume::ScalarType::kFloat64:
      return H5T_IEEE_F64LE;
  }
  return -1;
}

// The names of datasets that could be volumes.
std::vector<std::string> ListVolumes(hid_t file) {
  std::vector<std::string> names;
  const auto visit = [](hid_t root, const char* name, const H5O_info_t* info, void* out) -> herr_t {
    constexpr std::size_t kMaxNames = 50;
    auto* const found = static_cast<std::vector<std::string>*>(out);
    if (info->type != H5O_TYPE_DATASET || found->size() >= kMaxNames) {
      return 0;
    }
    const Hdf5Handle dataset(H5Dopen2(root, name, H5P_DEFAULT), H5Dclose);
    if (!dataset.is_valid()) {
      return 0;
    }
    const Hdf5Handle space(H5Dget_space(dataset.get()), H5Sclose);
    const Hdf5Handle type(H5Dget_type(dataset.get()), H5Tclose);
    std::array<std::size_t, 3> axes{};
    volume::ScalarType scalar{};
    if (FindAxes(VolumeDims(space.get()), &axes) && ScalarTypeOf(type.get(), &scalar)) {
      found->push_back(absl::StrCat("/", name));
    }
    return 0;
  };
  H5Ovisit2(file, H5_INDEX_NAME, H5_ITER_INC, visit, &names, H5O_INFO_BASIC);
  return names;
}

std::string Listed(const std::vector<std::string>& names) {
  return names.empty() ? "it holds no three-dimensional dataset of numbers"
                       : absl::StrCat("it holds ", absl::StrJoin(names, ", "));
}

class Hdf5Source final : public VolumeSource {
 public:
  Hdf5Source(const volume::GridGeometry& geometry, volume::ScalarType type, std::string name,
             std::vector<hsize_t> dims, const std::array<std::size_t, 3>& axes,
             std::int64_t cache_bytes, Hdf5Handle file, Hdf5Handle dataset)
      : geometry_(geometry),
        type_(type),
        name_(std::move(name)),
        dims_(std::move(dims)),
        axes_(axes),
        cache_bytes_(cache_bytes),
        file_(std::move(file)),
        dataset_(std::move(dataset)) {}

  [[nodiscard]] const volume::GridGeometry& geometry() const override { return geometry_; }
  [[nodiscard]] volume::ScalarType scalar_type() const override { return type_; }
  [[nodiscard]] const std::string& name() const override { return name_; }
  [[nodiscard]] std::int64_t memory_bytes() const override {
    return cache_bytes_ + kConversionBytes;
  }

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const math::Index3& dims = geometry_.sample_dims;
    ISOSCOPE_CHECK(begin_row >= 0 && begin_row < end_row && end_row <= dims.y * dims.z);
    const std::int64_t row_bytes = dims.x * static_cast<std::int64_t>(volume::SizeOf(type_));
    // Part of a plane, whole planes, part of a plane.
    while (begin_row < end_row) {
      const std::int64_t z = begin_row / dims.y;
      const std::int64_t y = begin_row % dims.y;
      std::int64_t planes = 1;
      std::int64_t rows = std::min(dims.y - y, end_row - begin_row);
      if (y == 0 && rows == dims.y) {
        planes = (end_row - begin_row) / dims.y;
      }
      ISOSCOPE_RETURN_IF_ERROR(ReadBox(z, planes, y, rows, out));
      out += planes * rows * row_bytes;
      begin_row += planes * rows;
    }
    return absl::OkStatus();
  }

 private:
  absl::Status ReadBox(std::int64_t z, std::int64_t planes, std::int64_t y, std::int64_t rows,
                       char* out) {
    std::vector<hsize_t> start(dims_.size(), 0);
    std::vector<hsize_t> count(dims_.size(), 1);
    start[axes_[0]] = static_cast<hsize_t>(z);
    start[axes_[1]] = static_cast<hsize_t>(y);
    count[axes_[0]] = static_cast<hsize_t>(planes);
    count[axes_[1]] = static_cast<hsize_t>(rows);
    count[axes_[2]] = static_cast<hsize_t>(geometry_.sample_dims.x);
    // The library does not write samples that the file lacks and that have no fill value.
    std::fill_n(
        out,
        static_cast<std::size_t>(planes * rows * geometry_.sample_dims.x) * volume::SizeOf(type_),
        '\0');
    const Hdf5Handle file_space(H5Dget_space(dataset_.get()), H5Sclose);
    const Hdf5Handle memory_space(
        H5Screate_simple(static_cast<int>(count.size()), count.data(), nullptr), H5Sclose);
    if (!file_space.is_valid() || !memory_space.is_valid() ||
        H5Sselect_hyperslab(file_space.get(), H5S_SELECT_SET, start.data(), nullptr, count.data(),
                            nullptr) < 0 ||
        H5Dread(dataset_.get(), MemoryTypeOf(type_), memory_space.get(), file_space.get(),
                H5P_DEFAULT, out) < 0) {
      return absl::DataLossError(
          absl::StrFormat("%s: planes %d to %d can't be read: %s: the file is damaged or cut, or "
                          "compressed with a filter that is not installed",
                          name_, z, z + planes - 1, LastHdf5Error()));
    }
    return absl::OkStatus();
  }

  const volume::GridGeometry geometry_;
  const volume::ScalarType type_;
  const std::string name_;
  const std::vector<hsize_t> dims_;        // of the dataset
  const std::array<std::size_t, 3> axes_;  // its z, y and x
  const std::int64_t cache_bytes_;
  const Hdf5Handle file_;
  const Hdf5Handle dataset_;
};

// Bytes of chunk cache: a layer of chunks. 0 for a dataset without chunks.
absl::StatusOr<std::int64_t> ChunkCacheBytes(hid_t dataset, const std::vector<hsize_t>& dims,
                                             const std::array<std::size_t, 3>& axes,
                                             std::size_t sample_size, const std::string& name) {
  const Hdf5Handle properties(H5Dget_create_plist(dataset), H5Pclose);
  if (H5Pget_layout(properties.get()) != H5D_CHUNKED) {
    return 0;
  }
  std::vector<hsize_t> chunk(dims.size());
  if (H5Pget_chunk(properties.get(), static_cast<int>(chunk.size()), chunk.data()) < 0) {
    return absl::DataLossError(absl::StrCat(name, ": its chunks can't be read: ", LastHdf5Error()));
  }
  double chunk_bytes = static_cast<double>(sample_size);
  double chunks = 1;
  for (std::size_t axis = 0; axis < dims.size(); ++axis) {
    chunk_bytes *= static_cast<double>(chunk[axis]);
    if (axis == axes[1] || axis == axes[2]) {
      const hsize_t along_axis = (dims[axis] + chunk[axis] - 1) / chunk[axis];
      chunks *= static_cast<double>(along_axis);
    }
  }
  if (chunk_bytes > static_cast<double>(kMaxChunkBytes)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: chunks of %.0f bytes; expected at most %d: write it with smaller chunks (h5repack)",
        name, chunk_bytes, kMaxChunkBytes));
  }
  const double layer_bytes = chunk_bytes * chunks;
  return std::max(
      static_cast<std::int64_t>(chunk_bytes),
      static_cast<std::int64_t>(std::min(layer_bytes, static_cast<double>(kMaxChunkCacheBytes))));
}

math::Vec3d SpacingOf(hid_t dataset) {
  math::Vec3d spacing{1, 1, 1};
  constexpr char kName[] = "element_size_um";
  if (H5Aexists(dataset, kName) <= 0) {
    return spacing;
  }
  const Hdf5Handle attribute(H5Aopen(dataset, kName, H5P_DEFAULT), H5Aclose);
  const Hdf5Handle space(H5Aget_space(attribute.get()), H5Sclose);
  std::array<double, 3> zyx{};
  if (H5Sget_simple_extent_npoints(space.get()) == 3 &&
      H5Aread(attribute.get(), H5T_NATIVE_DOUBLE, zyx.data()) >= 0) {
    spacing = {zyx[2], zyx[1], zyx[0]};
  }
  return spacing;
}

// A dataset and the file that holds it.
struct NamedDataset {
  Hdf5Path parts;  // with the dataset's name, given or found
  Hdf5Handle file;
  Hdf5Handle dataset;
};

absl::StatusOr<NamedDataset> OpenByName(const std::string& path) {
  Hdf5Path parts;
  if (!SplitHdf5Path(path, &parts)) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": no name of an HDF5 dataset"));
  }
  if (!io::PathExists(parts.file)) {
    return absl::NotFoundError(absl::StrCat(parts.file, ": no such file"));
  }
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);  // statuses report the errors
  Hdf5Handle file(H5Fopen(parts.file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
  if (!file.is_valid()) {
    return absl::InvalidArgumentError(absl::StrCat(parts.file,
                                                   ": can't be opened as HDF5: ", LastHdf5Error(),
                                                   ": no HDF5 file, or it is cut"));
  }
  if (parts.dataset.empty()) {
    const std::vector<std::string> names = ListVolumes(file.get());
    if (names.size() != 1) {
      return absl::InvalidArgumentError(absl::StrCat(parts.file, ": say which dataset, as in ",
                                                     parts.file, ":/name; ", Listed(names)));
    }
    parts.dataset = names[0];
  }
  Hdf5Handle dataset(H5Dopen2(file.get(), parts.dataset.c_str(), H5P_DEFAULT), H5Dclose);
  if (!dataset.is_valid()) {
    return absl::NotFoundError(absl::StrCat(parts.file, ": no dataset ", parts.dataset, "; ",
                                            Listed(ListVolumes(file.get()))));
  }
  return NamedDataset{
      .parts = std::move(parts), .file = std::move(file), .dataset = std::move(dataset)};
}

absl::StatusOr<std::vector<std::string>> FindFiles(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const NamedDataset named, OpenByName(path));
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<std::string> files,
                            FindHdf5Files(named.dataset.get(), named.parts.name()));
  // A link may lead past the file that the path names.
  if (std::find(files.begin(), files.end(), named.parts.file) == files.end()) {
    files.insert(files.begin(), named.parts.file);
  }
  return files;
}

absl::StatusOr<std::unique_ptr<VolumeSource>> Open(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(NamedDataset named, OpenByName(path));
  const Hdf5Path& parts = named.parts;
  Hdf5Handle& file = named.file;
  Hdf5Handle& dataset = named.dataset;
  const std::string name = parts.name();
  ISOSCOPE_RETURN_IF_ERROR(FindHdf5Files(dataset.get(), name).status());
  std::vector<hsize_t> dims;
  volume::ScalarType type{};
  std::array<std::size_t, 3> axes{};
  {
    const Hdf5Handle space(H5Dget_space(dataset.get()), H5Sclose);
    dims = VolumeDims(space.get());
    if (!FindAxes(dims, &axes)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: %d axes (%s elements); expected three, or three of more than one element; %s", name,
          H5Sget_simple_extent_ndims(space.get()), absl::StrJoin(dims, " x "),
          Listed(ListVolumes(file.get()))));
    }
    const Hdf5Handle stored(H5Dget_type(dataset.get()), H5Tclose);
    if (!ScalarTypeOf(stored.get(), &type)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: elements of %d bytes, class %d; expected integers of 8, 16 or 32 bits or IEEE "
          "floats "
          "of 32 or 64 bits",
          name, H5Tget_size(stored.get()), static_cast<int>(H5Tget_class(stored.get()))));
    }
  }
  volume::GridGeometry geometry;
  for (int axis = 0; axis < 3; ++axis) {
    geometry.sample_dims[axis] =
        static_cast<std::int64_t>(dims[axes[2 - static_cast<std::size_t>(axis)]]);
  }
  geometry.spacing = SpacingOf(dataset.get());
  const absl::Status valid = volume::Validate(geometry);
  if (!valid.ok()) {
    return absl::Status(valid.code(), absl::StrCat(name, ": ", valid.message()));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t cache_bytes,
                            ChunkCacheBytes(dataset.get(), dims, axes, volume::SizeOf(type), name));
  if (cache_bytes > 0) {
    const Hdf5Handle access(H5Pcreate(H5P_DATASET_ACCESS), H5Pclose);
    // A prime number of slots, far more than chunks; chunks that were read whole go first.
    constexpr std::size_t kSlots = 12421;
    H5Pset_chunk_cache(access.get(), kSlots, static_cast<std::size_t>(cache_bytes), 1.0);
    dataset = Hdf5Handle();
    dataset = Hdf5Handle(H5Dopen2(file.get(), parts.dataset.c_str(), access.get()), H5Dclose);
    if (!dataset.is_valid()) {
      return absl::DataLossError(absl::StrCat(name, ": can't be opened again: ", LastHdf5Error()));
    }
  }
  return std::make_unique<Hdf5Source>(geometry, type, name, std::move(dims), axes, cache_bytes,
                                      std::move(file), std::move(dataset));
}

constexpr WalledLibrary kHdf5 = {.name = "HDF5", .open = Open, .find_files = FindFiles};

}  // namespace

bool SplitHdf5Path(const std::string& path, Hdf5Path* parts) {
  PartPath split;
  if (!SplitPartPath(path, {".h5", ".hdf5", ".he5", ".hdf"}, &split)) {
    return false;
  }
  *parts = {split.file, split.part};
  return true;
}

absl::StatusOr<std::vector<std::string>> FilesOfHdf5Dataset(const std::string& path) {
  return FindFilesWalled(kHdf5, path);
}

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenHdf5Dataset(const std::string& path) {
  return OpenWalled(kHdf5, path);
}

}  // namespace isoscope::source
