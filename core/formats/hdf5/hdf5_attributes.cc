// Dimension Scales are datasets of one axis that hold the coordinates along an axis of another:
//
//   /u                       [50][64][64][64]
//     DIMENSION_LABELS       "t", "z", "", ""            a name by axis, "" if it has none
//     DIMENSION_LIST         { -> /time }, { -> /z }, {}, {}      references, any number by axis
//   /time                    [50]
//     CLASS = "DIMENSION_SCALE"
//
// Source: HDF5 Dimension Scale Specification, https://docs.hdfgroup.org/hdf5; netCDF-4 writes the
// same.

#include "core/formats/hdf5/hdf5_attributes.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"

#include "core/formats/hdf5/hdf5_dataset.h"
#include "core/source/hdf5/hdf5_far_file.h"
#include "hdf5.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxTexts = 64;
constexpr std::size_t kMaxTextSize = 65'536;

std::vector<std::string> ReadVariableTexts(hid_t attribute, hid_t stored, hid_t space,
                                           std::size_t count) {
  const Hdf5Handle type(H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(type.get(), H5T_VARIABLE);
  H5Tset_cset(type.get(), H5Tget_cset(stored));
  std::vector<char*> pointers(count, nullptr);
  std::vector<std::string> texts;
  if (H5Aread(attribute, type.get(), static_cast<void*>(pointers.data())) < 0) {
    return {};
  }
  texts.reserve(pointers.size());
  for (const char* pointer : pointers) {
    texts.emplace_back(pointer != nullptr ? std::string(pointer).substr(0, kMaxTextSize) : "");
  }
  H5Dvlen_reclaim(type.get(), space, H5P_DEFAULT, static_cast<void*>(pointers.data()));
  return texts;
}

std::vector<std::string> ReadFixedTexts(hid_t attribute, hid_t stored, std::size_t count) {
  const std::size_t size = H5Tget_size(stored);
  if (size == 0 || size > kMaxTextSize) {
    return {};
  }
  std::string bytes(size * count, '\0');
  if (H5Aread(attribute, stored, bytes.data()) < 0) {
    return {};
  }
  std::vector<std::string> texts;
  for (std::size_t i = 0; i < count; ++i) {
    const std::string text = bytes.substr(i * size, size);
    texts.push_back(text.substr(0, std::min(text.find('\0'), size)));
  }
  return texts;
}

}  // namespace

std::vector<std::string> Hdf5Texts(hid_t object, const char* attribute) {
  if (H5Aexists(object, attribute) <= 0) {
    return {};
  }
  const Hdf5Handle opened(H5Aopen(object, attribute, H5P_DEFAULT), H5Aclose);
  const Hdf5Handle space(H5Aget_space(opened.get()), H5Sclose);
  const Hdf5Handle stored(H5Aget_type(opened.get()), H5Tclose);
  const std::int64_t count = H5Sget_simple_extent_npoints(space.get());
  if (H5Tget_class(stored.get()) != H5T_STRING || count < 1 || count > kMaxTexts) {
    return {};
  }
  return H5Tis_variable_str(stored.get()) > 0
             ? ReadVariableTexts(opened.get(), stored.get(), space.get(),
                                 static_cast<std::size_t>(count))
             : ReadFixedTexts(opened.get(), stored.get(), static_cast<std::size_t>(count));
}

std::string Hdf5Text(hid_t object, const std::vector<const char*>& attributes) {
  for (const char* attribute : attributes) {
    const std::vector<std::string> texts = Hdf5Texts(object, attribute);
    if (!texts.empty() && !texts.front().empty()) {
      return texts.front();
    }
  }
  return "";
}

Hdf5Handle Hdf5ScaleOf(hid_t dataset, std::size_t axis, std::size_t rank) {
  constexpr char kList[] = "DIMENSION_LIST";
  if (H5Aexists(dataset, kList) <= 0) {
    return {};
  }
  const Hdf5Handle list(H5Aopen(dataset, kList, H5P_DEFAULT), H5Aclose);
  const Hdf5Handle space(H5Aget_space(list.get()), H5Sclose);
  const Hdf5Handle stored(H5Aget_type(list.get()), H5Tclose);
  const Hdf5Handle type(H5Tvlen_create(H5T_STD_REF_OBJ), H5Tclose);
  if (H5Sget_simple_extent_npoints(space.get()) != static_cast<hssize_t>(rank) ||
      H5Tget_class(stored.get()) != H5T_VLEN) {
    return {};
  }
  std::vector<hvl_t> references(rank);
  if (H5Aread(list.get(), type.get(), references.data()) < 0) {
    return {};
  }
  Hdf5Handle scale;
  if (references[axis].len > 0) {
    scale =
        Hdf5Handle(H5Rdereference2(dataset, H5P_DEFAULT, H5R_OBJECT, references[axis].p), H5Oclose);
  }
  H5Dvlen_reclaim(type.get(), space.get(), H5P_DEFAULT, references.data());
  return scale.is_valid() && H5Iget_type(scale.get()) == H5I_DATASET ? std::move(scale)
                                                                     : Hdf5Handle();
}

std::string Hdf5ScaleName(hid_t scale) {
  constexpr std::size_t kMaxName = 1024;
  std::string name(kMaxName, '\0');
  const ssize_t size = H5Iget_name(scale, name.data(), name.size());
  name.resize(size < 0 ? 0 : std::min(static_cast<std::size_t>(size), kMaxName - 1));
  return name.substr(name.rfind('/') + 1);
}

absl::StatusOr<std::vector<double>> Hdf5ScaleValues(hid_t scale, std::int64_t count) {
  const Hdf5Handle stored(H5Dget_type(scale), H5Tclose);
  const H5T_class_t kind = H5Tget_class(stored.get());
  // netCDF-4 writes a scale for each of its dimensions, with this name if nobody gave it values.
  if ((kind != H5T_INTEGER && kind != H5T_FLOAT) ||
      absl::StartsWith(Hdf5Text(scale, {"NAME"}), "This is a netCDF dimension but not")) {
    return std::vector<double>();
  }
  if (Hdf5DimsOf(scale) != std::vector<std::int64_t>{count}) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "its scale \"%s\" has another length than the axis, %d", Hdf5ScaleName(scale), count));
  }
  std::vector<double> values(static_cast<std::size_t>(count));
  if (ReadWholeHdf5(scale, H5T_NATIVE_DOUBLE, values.data()) < 0) {
    return absl::DataLossError(absl::StrFormat("its scale \"%s\" can't be read: %s",
                                               Hdf5ScaleName(scale), LastHdf5Error()));
  }
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!std::isfinite(values[i]) || (i > 0 && !(values[i] > values[i - 1]))) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "its scale \"%s\" has %g at index %d, behind %g; expected finite numbers that ascend, "
          "each once",
          Hdf5ScaleName(scale), values[i], i, i > 0 ? values[i - 1] : values[i]));
    }
  }
  return values;
}

}  // namespace isoscope::source
