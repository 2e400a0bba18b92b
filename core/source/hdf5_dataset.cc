#include "core/source/hdf5_dataset.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <functional>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/source/axis_order.h"
#include "hdf5.h"

namespace isoscope::source {
namespace {

// Its rank alone is checked first: the library gives no more than 32.
std::vector<std::int64_t> DimsOfSpace(hid_t space) {
  const int rank = H5Sget_simple_extent_ndims(space);
  if (rank < 0 || rank > H5S_MAX_RANK) {
    return {};
  }
  std::vector<hsize_t> dims(static_cast<std::size_t>(rank));
  H5Sget_simple_extent_dims(space, dims.data(), nullptr);
  return {dims.begin(), dims.end()};
}

bool VolumeTypeOf(hid_t type, volume::ScalarType* scalar) {
  const std::size_t size = H5Tget_size(type);
  const H5T_class_t kind = H5Tget_class(type);
  if (kind == H5T_FLOAT) {
    // Those of IEEE alone: what the library makes of other bits depends on how much is read at
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

// IEEE 754 binary16: sign, 5 bits of exponent with the bias 15, 10 of fraction.
bool IsHalf(hid_t type) {
  std::size_t sign = 0;
  std::size_t exponent = 0;
  std::size_t exponent_bits = 0;
  std::size_t fraction = 0;
  std::size_t fraction_bits = 0;
  const H5T_order_t order = H5Tget_order(type);
  return H5Tget_class(type) == H5T_FLOAT && H5Tget_size(type) == 2 &&
         H5Tget_precision(type) == 16 && H5Tget_offset(type) == 0 &&
         H5Tget_fields(type, &sign, &exponent, &exponent_bits, &fraction, &fraction_bits) >= 0 &&
         sign == 15 && exponent == 10 && exponent_bits == 5 && fraction == 0 &&
         fraction_bits == 10 && H5Tget_ebias(type) == 15 && H5Tget_norm(type) == H5T_NORM_IMPLIED &&
         (order == H5T_ORDER_LE || order == H5T_ORDER_BE);
}

// h5py's bool: an enumeration of one byte with FALSE = 0 and TRUE = 1.
bool IsBool(hid_t type) {
  if (H5Tget_class(type) != H5T_ENUM || H5Tget_size(type) != 1 || H5Tget_nmembers(type) != 2) {
    return false;
  }
  for (unsigned int i = 0; i < 2; ++i) {
    char value = 2;
    char* const name = H5Tget_member_name(type, i);
    const std::string upper = absl::AsciiStrToUpper(name != nullptr ? name : "");
    H5free_memory(name);
    if (H5Tget_member_value(type, i, &value) < 0 || (value != 0 && value != 1) ||
        upper != (value == 0 ? "FALSE" : "TRUE")) {
      return false;
    }
  }
  return true;
}

bool SampleTypeOf(hid_t stored, Hdf5Types types, Hdf5SampleType* type) {
  if (VolumeTypeOf(stored, &type->scalar)) {
    type->memory_type = Hdf5Handle(H5Tcopy(MemoryTypeOf(type->scalar)), H5Tclose);
    return true;
  }
  if (types == Hdf5Types::kOfVolumes) {
    return false;
  }
  if (H5Tget_class(stored) == H5T_INTEGER && H5Tget_size(stored) == 8) {
    const bool is_signed = H5Tget_sign(stored) == H5T_SGN_2;
    type->wide = is_signed ? WideType::kInt64 : WideType::kUint64;
    type->memory_type = Hdf5Handle(H5Tcopy(is_signed ? H5T_STD_I64LE : H5T_STD_U64LE), H5Tclose);
  } else if (IsHalf(stored)) {
    type->wide = WideType::kFloat16;
    type->memory_type = Hdf5Handle(H5Tcopy(stored), H5Tclose);
    H5Tset_order(type->memory_type.get(), H5T_ORDER_LE);
  } else if (IsBool(stored)) {
    type->scalar = volume::ScalarType::kUint8;
    type->memory_type = Hdf5Handle(H5Tcopy(stored), H5Tclose);
    return type->memory_type.is_valid();
  } else {
    return false;
  }
  type->scalar = CarrierType(*type->wide);
  return type->memory_type.is_valid();
}

// The names of datasets of numbers for which `is_wanted` is true of their dimensions.
using WantedDims = std::function<bool(const std::vector<std::int64_t>&)>;
struct DatasetSearch {
  Hdf5Types types;
  const WantedDims& is_wanted;
  std::vector<std::string> names{};
};

std::vector<std::string> ListDatasets(hid_t file, Hdf5Types types, const WantedDims& is_wanted) {
  DatasetSearch search{.types = types, .is_wanted = is_wanted};
  const auto visit = [](hid_t root, const char* name, const H5O_info_t* info, void* out) -> herr_t {
    constexpr std::size_t kMaxNames = 50;
    auto* const found = static_cast<DatasetSearch*>(out);
    if (info->type != H5O_TYPE_DATASET || found->names.size() >= kMaxNames) {
      return 0;
    }
    const Hdf5Handle dataset(H5Dopen2(root, name, H5P_DEFAULT), H5Dclose);
    if (!dataset.is_valid()) {
      return 0;
    }
    const Hdf5Handle stored(H5Dget_type(dataset.get()), H5Tclose);
    Hdf5SampleType type;
    if (found->is_wanted(Hdf5DimsOf(dataset.get())) &&
        SampleTypeOf(stored.get(), found->types, &type)) {
      found->names.push_back(absl::StrCat("/", name));
    }
    return 0;
  };
  H5Ovisit2(file, H5_INDEX_NAME, H5_ITER_INC, visit, &search, H5O_INFO_BASIC);
  return std::move(search.names);
}

std::vector<std::string> ListVolumes(hid_t file) {
  return ListDatasets(file, Hdf5Types::kOfVolumes, [](const std::vector<std::int64_t>& dims) {
    return PlainAxisOrder(dims).has_value();
  });
}

// Those that a path may name.
std::vector<std::string> ListNamed(hid_t file, Hdf5Types types, std::size_t axes) {
  if (types == Hdf5Types::kOfVolumes) {
    return ListVolumes(file);
  }
  return ListDatasets(file, types, [axes](const std::vector<std::int64_t>& dims) {
    return axes > 0 ? dims.size() == axes : dims.size() >= 3;
  });
}

// Those that a path without a name may mean: the only volume that there is goes before all others.
std::vector<std::string> ListCandidates(hid_t file, Hdf5Types types, std::size_t axes) {
  std::vector<std::string> volumes;
  if (axes == 0) {
    volumes = ListVolumes(file);
  }
  return volumes.size() == 1 ? volumes : ListNamed(file, types, axes);
}

std::string Listed(const std::vector<std::string>& names) {
  return names.empty() ? "it holds no three-dimensional dataset of numbers"
                       : absl::StrCat("it holds ", absl::StrJoin(names, ", "));
}

}  // namespace

absl::StatusOr<Hdf5SampleType> Hdf5SampleTypeOf(hid_t dataset, Hdf5Types types) {
  const Hdf5Handle stored(H5Dget_type(dataset), H5Tclose);
  Hdf5SampleType type;
  if (!SampleTypeOf(stored.get(), types, &type)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "elements of %d bytes, class %d; expected integers of 8, 16%s bits%s or IEEE floats of %s "
        "bits",
        H5Tget_size(stored.get()), static_cast<int>(H5Tget_class(stored.get())),
        types == Hdf5Types::kAll ? ", 32 or 64" : " or 32",
        types == Hdf5Types::kAll ? ", bool" : "",
        types == Hdf5Types::kAll ? "16, 32 or 64" : "32 or 64"));
  }
  return type;
}

std::vector<std::int64_t> Hdf5DimsOf(hid_t dataset) {
  const Hdf5Handle space(H5Dget_space(dataset), H5Sclose);
  return DimsOfSpace(space.get());
}

absl::StatusOr<NamedHdf5Dataset> OpenHdf5ByName(const std::string& path, Hdf5Types types,
                                                std::size_t axes) {
  Hdf5Path parts;
  if (!SplitHdf5Path(path, &parts)) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": no name of an HDF5 dataset"));
  }
  if (!io::PathExists(parts.file)) {
    return absl::NotFoundError(absl::StrCat(parts.file, ": no such file"));
  }
  ISOSCOPE_RETURN_IF_ERROR(io::CheckIsRegularFile(parts.file));  // HDF5 would wait for a writer
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);                   // errors are ours to report
  Hdf5Handle file(H5Fopen(parts.file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
  if (!file.is_valid()) {
    return absl::InvalidArgumentError(absl::StrCat(parts.file,
                                                   ": can't be opened as HDF5: ", LastHdf5Error(),
                                                   ": no HDF5 file, or it is cut"));
  }
  if (parts.dataset.empty()) {
    const std::vector<std::string> names = ListCandidates(file.get(), types, axes);
    if (names.size() != 1) {
      return absl::InvalidArgumentError(absl::StrCat(parts.file, ": say which dataset, as in ",
                                                     parts.file, ":/name; ", Listed(names)));
    }
    parts.dataset = names[0];
  }
  Hdf5Handle dataset(H5Dopen2(file.get(), parts.dataset.c_str(), H5P_DEFAULT), H5Dclose);
  if (!dataset.is_valid()) {
    return absl::NotFoundError(absl::StrCat(parts.file, ": no dataset ", parts.dataset, "; ",
                                            Listed(ListNamed(file.get(), types, axes))));
  }
  return NamedHdf5Dataset{
      .parts = std::move(parts), .file = std::move(file), .dataset = std::move(dataset)};
}

std::string ListHdf5Volumes(hid_t file) { return Listed(ListVolumes(file)); }

}  // namespace isoscope::source
