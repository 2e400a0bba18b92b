// A NeXus file, with the attributes of groups and datasets behind '@':
//
//   /                        @default = "entry"
//   /entry                   @NX_class = "NXentry", @default = "data"
//   /entry/data              @NX_class = "NXdata", @signal = "counts", @axes = ["z", ".", "x"],
//                            @z_indices = 0
//   /entry/data/counts       [20][64][64]
//   /entry/data/z            [20], or [21]: the borders between samples; @units = "mm"
//
//   /entry/data/z_offset, z_scaling_factor      of z: (value + offset) * factor; 0 and 1 by default
//
// "." is an axis without coordinates. Before 2014 the dataset had them: @signal = 1, @axes =
// "z:y:x".
//
// Source: NeXus manual, NXdata and "Associating plottable data with axis data",
// https://manual.nexusformat.org.

#include "core/formats/hdf5/nexus_data.h"

#include <cmath>
#include <cstdint>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"

#include "core/base/status_macros.h"
#include "core/formats/hdf5/hdf5_attributes.h"
#include "core/formats/hdf5/hdf5_mesh.h"
#include "core/source/hdf5/hdf5_far_file.h"
#include "core/source/hdf5/hdf5_handle.h"

namespace isoscope::source {
namespace {

std::string NexusClass(hid_t object) { return Hdf5Text(object, {"NX_class"}); }

// The path of the group that `default` names, or of the only one of that class. "" without one.
std::string NextGroup(hid_t group, const std::string& path, const char* group_class) {
  const std::string named = Hdf5Text(group, {"default"});
  std::string only;
  int count = 0;
  for (const std::string& name : Hdf5NamesIn(group)) {
    const Hdf5Handle child(H5Oopen(group, name.c_str(), H5P_DEFAULT), H5Oclose);
    if (child.is_valid() && H5Iget_type(child.get()) == H5I_GROUP &&
        NexusClass(child.get()) == group_class) {
      only = name;
      ++count;
    }
    if (name == named && child.is_valid()) {
      return absl::StrCat(path, named, "/");
    }
  }
  return named.empty() && count == 1 ? absl::StrCat(path, only, "/") : "";
}

std::vector<std::string> SplitAxes(const std::vector<std::string>& texts) {
  if (texts.size() != 1) {
    return texts;
  }
  return absl::StrSplit(texts[0], absl::ByAnyChar(":,[] "), absl::SkipEmpty());
}

// Puts each name where `NAME_indices` says; else in the order of the list.
absl::StatusOr<std::vector<std::string>> AxesOfGroup(hid_t group, std::size_t rank) {
  const std::vector<std::string> listed = SplitAxes(Hdf5Texts(group, "axes"));
  std::vector<std::string> axes(listed.empty() ? 0 : rank);
  for (std::size_t i = 0; i < listed.size(); ++i) {
    const std::string& name = listed[i];
    if (name == "." || name.empty()) {
      continue;
    }
    const std::vector<double> indices = Hdf5Numbers(group, absl::StrCat(name, "_indices").c_str());
    if (indices.size() > 1) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "its coordinates \"%s\" depend on %d axes: the grid is curved, and is not read", name,
          indices.size()));
    }
    if (indices.empty() && listed.size() != rank) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "its group names %d axes (%s), but it has %d; expected a name for each, \".\" for none",
          listed.size(), absl::StrJoin(listed, ", "), rank));
    }
    const double index = indices.empty() ? static_cast<double>(i) : indices[0];
    if (!(index >= 0 && index < static_cast<double>(rank)) || index != std::floor(index)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "its coordinates \"%s\" are those of axis %g; expected 0 to %d", name, index, rank - 1));
    }
    axes[static_cast<std::size_t>(index)] = name;
  }
  return axes;
}

// The number in a dataset of one element; `fallback` if there is none.
absl::StatusOr<double> NumberInDataset(hid_t group, const std::string& name, double fallback) {
  if (H5Lexists(group, name.c_str(), H5P_DEFAULT) <= 0) {
    return fallback;
  }
  const Hdf5Handle dataset(H5Dopen2(group, name.c_str(), H5P_DEFAULT), H5Dclose);
  const Hdf5Handle type(dataset.is_valid() ? H5Dget_type(dataset.get()) : H5I_INVALID_HID,
                        H5Tclose);
  const Hdf5Handle space(dataset.is_valid() ? H5Dget_space(dataset.get()) : H5I_INVALID_HID,
                         H5Sclose);
  const H5T_class_t kind = type.is_valid() ? H5Tget_class(type.get()) : H5T_NO_CLASS;
  double number = 0;
  if ((kind != H5T_INTEGER && kind != H5T_FLOAT) ||
      H5Sget_simple_extent_npoints(space.get()) != 1 ||
      ReadWholeHdf5(dataset.get(), H5T_NATIVE_DOUBLE, &number) < 0 || !std::isfinite(number)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "its group has \"%s\", which is not one finite number; expected a scale of the values: "
        "correct it, or remove it",
        name));
  }
  return number;
}

absl::StatusOr<NexusScale> ScaleIn(hid_t group, const std::string& factor,
                                   const std::string& offset) {
  NexusScale scale;
  ISOSCOPE_ASSIGN_OR_RETURN(scale.factor, NumberInDataset(group, factor, 1));
  ISOSCOPE_ASSIGN_OR_RETURN(scale.offset, NumberInDataset(group, offset, 0));
  if (scale.factor == 0) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "its group has \"%s\" of 0; expected a factor of the values: correct it, or remove it",
        factor));
  }
  return scale;
}

}  // namespace

absl::StatusOr<NexusScale> FindNexusScale(hid_t group, const std::string& name) {
  return ScaleIn(group, absl::StrCat(name, "_scaling_factor"), absl::StrCat(name, "_offset"));
}

absl::StatusOr<NexusScale> FindNexusSignalScale(hid_t group, const std::string& name) {
  ISOSCOPE_ASSIGN_OR_RETURN(const NexusScale own, FindNexusScale(group, name));
  return own == NexusScale() && FindNexusSignal(group) == name
             ? ScaleIn(group, "scaling_factor", "offset")
             : absl::StatusOr<NexusScale>(own);
}

std::string FindNexusDefault(hid_t file) {
  std::string path = "/";
  for (const char* group_class : {"NXentry", "NXdata"}) {
    const Hdf5Handle group(H5Gopen2(file, path.c_str(), H5P_DEFAULT), H5Gclose);
    if (group.is_valid() && NexusClass(group.get()) == "NXdata") {
      break;  // `default` of the root may name it at once
    }
    path = group.is_valid() ? NextGroup(group.get(), path, group_class) : "";
    if (path.empty()) {
      return "";
    }
  }
  const Hdf5Handle plot(H5Gopen2(file, path.c_str(), H5P_DEFAULT), H5Gclose);
  const std::string signal = plot.is_valid() ? FindNexusSignal(plot.get()) : "";
  return signal.empty() ? "" : path + signal;
}

std::string FindNexusSignal(hid_t group) {
  if (NexusClass(group) != "NXdata") {
    return "";
  }
  if (std::string signal = Hdf5Text(group, {"signal"}); !signal.empty()) {
    return signal;
  }
  for (const std::string& name : Hdf5NamesIn(group)) {
    const Hdf5Handle child(H5Oopen(group, name.c_str(), H5P_DEFAULT), H5Oclose);
    if (child.is_valid() && H5Iget_type(child.get()) == H5I_DATASET &&
        (Hdf5Numbers(child.get(), "signal") == std::vector<double>{1} ||
         Hdf5Text(child.get(), {"signal"}) == "1")) {
      return name;
    }
  }
  return "";
}

absl::StatusOr<std::vector<std::string>> FindNexusAxes(hid_t group, const std::string& name,
                                                       std::size_t rank) {
  std::vector<std::string> signals = Hdf5Texts(group, "auxiliary_signals");
  signals.push_back(FindNexusSignal(group));
  bool is_plotted = false;
  for (const std::string& signal : signals) {
    is_plotted = is_plotted || signal == name;
  }
  if (!is_plotted || NexusClass(group) != "NXdata") {
    return std::vector<std::string>();
  }
  if (H5Aexists(group, "axes") > 0) {
    return AxesOfGroup(group, rank);
  }
  const Hdf5Handle dataset(H5Oopen(group, name.c_str(), H5P_DEFAULT), H5Oclose);
  std::vector<std::string> axes = SplitAxes(Hdf5Texts(dataset.get(), "axes"));
  if (axes.size() != rank) {
    return std::vector<std::string>();
  }
  for (std::string& axis : axes) {
    axis = axis == "." ? "" : axis;
  }
  return axes;
}

}  // namespace isoscope::source
