// MINC 2 in HDF5, with the attributes that count behind '@':
//
//   /minc-2.0/dimensions/xspace     @start, @step, @direction_cosines, @units, @spacing
//   /minc-2.0/image/0/image         @valid_range
//   /minc-2.0/image/0/image-max     one number, or one for each slice
//   /minc-2.0/image/0/image-min

#include "core/formats/netcdf/minc2_header.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/formats/netcdf/minc_axis.h"
#include "core/source/grid/stack_layout.h"
#include "core/source/hdf5/hdf5_file.h"
#include "core/source/hdf5/hdf5_handle.h"
#include "hdf5.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxMincNumbers = 64;
constexpr std::int64_t kMaxMincLimits = std::int64_t{1} << 24;
constexpr std::size_t kMaxMincText = 4096;

// None if there is no such attribute. INVALID_ARGUMENT: it is not of numbers.
absl::StatusOr<std::vector<double>> MincNumbers(hid_t object, const std::string& name,
                                                const char* attribute) {
  std::vector<double> numbers;
  if (H5Aexists(object, attribute) <= 0) {
    return numbers;
  }
  const Hdf5Handle opened(H5Aopen(object, attribute, H5P_DEFAULT), H5Aclose);
  const Hdf5Handle space(H5Aget_space(opened.get()), H5Sclose);
  const Hdf5Handle stored(H5Aget_type(opened.get()), H5Tclose);
  const H5T_class_t kind = H5Tget_class(stored.get());
  const std::int64_t count = H5Sget_simple_extent_npoints(space.get());
  const bool is_good =
      (kind == H5T_INTEGER || kind == H5T_FLOAT) && count >= 1 && count <= kMaxMincNumbers;
  numbers.resize(is_good ? static_cast<std::size_t>(count) : 0);
  if (!is_good || H5Aread(opened.get(), H5T_NATIVE_DOUBLE, numbers.data()) < 0) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "the %s of %s is no number: correct it (minc_modify_header)", attribute, name));
  }
  return numbers;
}

// "" if there is no such attribute of text.
std::string MincText(hid_t object, const char* attribute) {
  if (H5Aexists(object, attribute) <= 0) {
    return "";
  }
  const Hdf5Handle opened(H5Aopen(object, attribute, H5P_DEFAULT), H5Aclose);
  const Hdf5Handle space(H5Aget_space(opened.get()), H5Sclose);
  const Hdf5Handle stored(H5Aget_type(opened.get()), H5Tclose);
  if (H5Tget_class(stored.get()) != H5T_STRING || H5Sget_simple_extent_npoints(space.get()) != 1) {
    return "";
  }
  if (H5Tis_variable_str(stored.get()) > 0) {
    const Hdf5Handle type(H5Tcopy(H5T_C_S1), H5Tclose);
    H5Tset_size(type.get(), H5T_VARIABLE);
    H5Tset_cset(type.get(), H5Tget_cset(stored.get()));
    char* pointer = nullptr;
    if (H5Aread(opened.get(), type.get(), static_cast<void*>(&pointer)) < 0) {
      return "";
    }
    std::string text = pointer != nullptr ? std::string(pointer).substr(0, kMaxMincText) : "";
    H5Dvlen_reclaim(type.get(), space.get(), H5P_DEFAULT, static_cast<void*>(&pointer));
    return text;
  }
  const std::size_t size = H5Tget_size(stored.get());
  std::string bytes(size <= kMaxMincText ? size : 0, '\0');
  if (bytes.empty() || H5Aread(opened.get(), stored.get(), bytes.data()) < 0) {
    return "";
  }
  return bytes.substr(0, std::min(bytes.find('\0'), size));
}

// Returns the factor that turns the lengths of an axis of the image to millimetres.
absl::StatusOr<double> CheckMinc2Axis(hid_t file, const std::string& name) {
  const Hdf5Handle dimension(
      H5Dopen2(file, absl::StrCat("/minc-2.0/dimensions/", name).c_str(), H5P_DEFAULT), H5Dclose);
  if (!dimension.is_valid()) {
    return 1;
  }
  MincAxis axis{.name = name};
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> start,
                            MincNumbers(dimension.get(), name, "start"));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> step,
                            MincNumbers(dimension.get(), name, "step"));
  ISOSCOPE_ASSIGN_OR_RETURN(axis.cosines, MincNumbers(dimension.get(), name, "direction_cosines"));
  axis.start = start.empty() ? axis.start : start[0];
  axis.step = step.empty() ? axis.step : step[0];
  axis.spacing = MincText(dimension.get(), "spacing");
  axis.unit = MincText(dimension.get(), "units");
  ISOSCOPE_RETURN_IF_ERROR(CheckMincAxis(axis));
  const std::optional<LengthUnit> unit = LengthUnitOf(MincUnitOf(axis));
  if (!unit.has_value()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("the units of %s are \"%s\"; expected a unit of length, as \"mm\": correct "
                        "them (minc_modify_header)",
                        name, base::Printable(MincUnitOf(axis).substr(0, 40))));
  }
  return MincUnitFactor(MincUnitOf(axis), "mm");
}

absl::Status CheckMinc2Scale(hid_t file) {
  const Hdf5Handle image(H5Dopen2(file, "/minc-2.0/image/0/image", H5P_DEFAULT), H5Dclose);
  if (!image.is_valid()) {
    return absl::OkStatus();
  }
  const Hdf5Handle type(H5Dget_type(image.get()), H5Tclose);
  if (H5Tget_class(type.get()) != H5T_INTEGER) {
    return absl::OkStatus();  // floats are real values already, and labels have none
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> valid,
                            MincNumbers(image.get(), "image", "valid_range"));
  ISOSCOPE_RETURN_IF_ERROR(CheckMincNumbers("valid_range", valid));
  for (const char* name : {"image-max", "image-min"}) {
    const Hdf5Handle limits(
        H5Dopen2(file, absl::StrCat("/minc-2.0/image/0/", name).c_str(), H5P_DEFAULT), H5Dclose);
    if (!limits.is_valid()) {
      continue;
    }
    const Hdf5Handle space(H5Dget_space(limits.get()), H5Sclose);
    const std::int64_t count = H5Sget_simple_extent_npoints(space.get());
    if (count < 1 || count > kMaxMincLimits) {
      return absl::InvalidArgumentError(
          absl::StrFormat("its %s has %d numbers; expected 1 to %d", name, count, kMaxMincLimits));
    }
    std::vector<double> numbers(static_cast<std::size_t>(count));
    if (H5Dread(limits.get(), H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, numbers.data()) <
        0) {
      return absl::DataLossError(
          absl::StrFormat("its %s can't be read: %s", name, LastHdf5Error()));
    }
    ISOSCOPE_RETURN_IF_ERROR(CheckMincNumbers(name, numbers));
  }
  return absl::OkStatus();
}

absl::Status NamedMinc2(const std::string& path, const absl::Status& status) {
  return status.ok()
             ? status
             : absl::Status(status.code(), absl::StrCat(path, ": MINC 2: ", status.message()));
}

}  // namespace

absl::StatusOr<std::array<double, 3>> CheckMinc2Header(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Hdf5Handle file, OpenHdf5File(path));
  std::array<double, 3> factors{1, 1, 1};
  for (std::size_t axis = 0; axis < factors.size(); ++axis) {
    const auto factor =
        CheckMinc2Axis(file.get(), absl::StrCat(std::string(1, "xyz"[axis]), "space"));
    ISOSCOPE_RETURN_IF_ERROR(NamedMinc2(path, factor.status()));
    factors[axis] = *factor;
  }
  ISOSCOPE_RETURN_IF_ERROR(NamedMinc2(path, CheckMinc2Scale(file.get())));
  return factors;
}

}  // namespace isoscope::source
