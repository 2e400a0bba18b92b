// Four places name an axis or give its coordinates; the first one that does counts:
//
//   NeXus             a dataset in the same group, which the group names (nexus_data.h)
//   dimension scales  a dataset that DIMENSION_LIST refers to (hdf5_attributes.h)
//   DIMENSION_LABELS  a name alone
//   axes, axistags    a name alone, of all axes
//
// cf_grid.h makes roles and grids of them, as of netCDF's. Coordinates of HDF5 never count down by
// their name: that is a rule of CF.

#include "core/formats/hdf5/hdf5_coordinates.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/printable.h"
#include "core/base/shell_word.h"
#include "core/base/status_macros.h"
#include "core/formats/hdf5/hdf5_attributes.h"
#include "core/formats/hdf5/hdf5_mesh.h"
#include "core/formats/hdf5/nexus_data.h"
#include "core/source/grid/sample_distance.h"
#include "core/source/hdf5/hdf5_far_file.h"
#include "core/source/hdf5/hdf5_handle.h"
#include "hdf5.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxHdf5Axis = std::int64_t{1} << 24;

// Borders become the middles between them.
void TakeMiddles(std::vector<double>* values) {
  for (std::size_t i = 0; i + 1 < values->size(); ++i) {
    (*values)[i] = (*values)[i] / 2 + (*values)[i + 1] / 2;
  }
  values->pop_back();
}

// Adds what a dataset says of the axis that it holds the coordinates of. One that is not of numbers
// says no more than its name.
absl::Status TakeCoordinates(hid_t dataset, CfAxis* axis) {
  axis->units = Hdf5Text(dataset, {"units", "unit"});
  axis->axis = Hdf5Text(dataset, {"axis"});
  axis->standard_name = Hdf5Text(dataset, {"standard_name"});
  axis->positive = Hdf5Text(dataset, {"positive"});
  const Hdf5Handle stored(H5Dget_type(dataset), H5Tclose);
  const H5T_class_t kind = H5Tget_class(stored.get());
  // netCDF-4 writes a scale for each of its dimensions, with this name if nobody gave it values.
  if ((kind != H5T_INTEGER && kind != H5T_FLOAT) ||
      absl::StartsWith(Hdf5Text(dataset, {"NAME"}), "This is a netCDF dimension but not")) {
    return absl::OkStatus();
  }
  const std::vector<std::int64_t> dims = Hdf5DimsOf(dataset);
  if (dims.size() != 1 || (dims[0] != axis->size && dims[0] != axis->size + 1) ||
      dims[0] > kMaxHdf5Axis) {
    return absl::InvalidArgumentError(
        absl::StrFormat("its coordinates \"%s\" have %s elements; expected %d, or %d borders",
                        axis->name, absl::StrJoin(dims, " x "), axis->size, axis->size + 1));
  }
  axis->is_single = kind == H5T_FLOAT && H5Tget_size(stored.get()) <= sizeof(float);
  axis->values.resize(static_cast<std::size_t>(dims[0]));
  if (ReadWholeHdf5(dataset, H5T_NATIVE_DOUBLE, axis->values.data()) < 0) {
    return absl::DataLossError(
        absl::StrFormat("its coordinates \"%s\" can't be read: %s", axis->name, LastHdf5Error()));
  }
  if (dims[0] == axis->size + 1) {
    TakeMiddles(&axis->values);
  }
  return absl::OkStatus();
}

// INVALID_ARGUMENT: the group says that the values of its plot are other ones than it stores.
absl::Status CheckNexusValues(hid_t group, const std::string& signal) {
  ISOSCOPE_ASSIGN_OR_RETURN(const NexusScale scale, FindNexusSignalScale(group, signal));
  if (scale == NexusScale()) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(absl::StrFormat(
      "its group scales the values by %s_scaling_factor and %s_offset (or scaling_factor and "
      "offset), (value + %g) * %g, but samples are read as they are stored: write the scaled "
      "values, and remove both",
      signal, signal, scale.offset, scale.factor));
}

// The axes by NeXus; false if the dataset is in no plot. Names of coordinates that are not there
// are names alone, if none of them is; else they are faults.
absl::StatusOr<bool> TakeNexusAxes(const NamedHdf5Dataset& named, std::vector<CfAxis>* axes) {
  const std::string& path = named.parts.dataset;
  const std::size_t slash = path.rfind('/') + 1;  // 0 without one: in the root
  const Hdf5Handle group(
      H5Gopen2(named.file.get(), slash == 0 ? "/" : path.substr(0, slash).c_str(), H5P_DEFAULT),
      H5Gclose);
  if (!group.is_valid()) {
    return false;
  }
  const std::string signal = path.substr(slash);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> names,
                            FindNexusAxes(group.get(), signal, axes->size()));
  std::vector<std::size_t> missing;
  bool are_names_alone = true;
  for (std::size_t i = 0; i < names.size(); ++i) {
    CfAxis& axis = (*axes)[i];
    axis.name = names[i];
    const Hdf5Handle dataset(
        names[i].empty() ? H5I_INVALID_HID : H5Dopen2(group.get(), names[i].c_str(), H5P_DEFAULT),
        H5Dclose);
    if (dataset.is_valid()) {
      are_names_alone = false;
      ISOSCOPE_RETURN_IF_ERROR(TakeCoordinates(dataset.get(), &axis));
      ISOSCOPE_ASSIGN_OR_RETURN(const NexusScale scale, FindNexusScale(group.get(), names[i]));
      for (double& value : axis.values) {
        value = scale.Apply(value);
      }
    } else if (!names[i].empty()) {
      missing.push_back(i);
    }
  }
  for (std::size_t i = 0; i < missing.size() && !are_names_alone; ++i) {
    CfAxis& axis = (*axes)[missing[i]];
    const absl::Status fault = NoSampleDistance(
        "", absl::StrFormat("its group names the coordinates \"%s\" of axis %d, and has no such "
                            "dataset (\".\" stands for none)",
                            base::Printable(axis.name), missing[i]));
    axis.fault = std::string(fault.message());
  }
  if (!names.empty()) {
    ISOSCOPE_RETURN_IF_ERROR(CheckNexusValues(group.get(), signal));
  }
  return !names.empty();
}

// Names of all axes, in one attribute of the dataset.
std::vector<std::string> NamesInOneAttribute(hid_t dataset, std::size_t rank) {
  for (const char* attribute : {"axes", "axistags"}) {
    const std::vector<std::string> texts = Hdf5Texts(dataset, attribute);
    std::vector<std::string> names = texts.size() == 1 ? AxisLabelsIn(texts[0]) : texts;
    if (names.size() == rank) {
      return names;
    }
  }
  return {};
}

// The letters of the axes that have more than one element, or of all if there are only three; '-'
// for others.
std::string LettersByName(const std::vector<CfAxis>& axes) {
  std::string letters;
  for (const CfAxis& axis : axes) {
    letters.push_back(axis.size == 1 && axes.size() > 3 ? '-' : CfLetterOf(axis));
  }
  return letters;
}

// Not set if they are not X, Y, Z, and at most one T and C.
std::optional<Hdf5Layout> LayoutOfLetters(const std::string& letters) {
  Hdf5Layout layout;
  CfRoles& roles = layout.roles;
  std::size_t space = 0;
  for (std::size_t i = 0; i < letters.size(); ++i) {
    std::optional<std::size_t>* const other = letters[i] == 'T'   ? &roles.time
                                              : letters[i] == 'C' ? &roles.component
                                                                  : nullptr;
    if (letters[i] == '-') {
      continue;
    }
    if (other != nullptr ? other->has_value()
                         : space == 3 || letters[i] < 'X' || letters[i] > 'Z') {
      return std::nullopt;
    }
    if (other != nullptr) {
      *other = i;
    } else {
      roles.space[space] = i;
      roles.letters[space++] = letters[i];
    }
  }
  std::array<char, 3> sorted = roles.letters;
  std::sort(sorted.begin(), sorted.end());
  if (space != 3 || sorted != std::array<char, 3>{'X', 'Y', 'Z'}) {
    return std::nullopt;
  }
  layout.order = {.z = roles.space[0],
                  .y = roles.space[1],
                  .x = roles.space[2],
                  .t = roles.time,
                  .c = roles.component};
  return layout;
}

absl::StatusOr<Hdf5Layout> LayoutAsGiven(const std::vector<CfAxis>& axes,
                                         const std::string& letters, const std::string& shape) {
  const auto layout = LayoutOfLetters(absl::AsciiStrToUpper(letters));
  if (!layout.has_value() || letters.size() != axes.size()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%d axes (%s elements): --axes %s; expected %d letters, slowest first: Z, Y and X in any "
        "order, at most one T (time) and one C (components)",
        axes.size(), shape, letters, axes.size()));
  }
  for (std::size_t axis = 0; axis < letters.size(); ++axis) {
    if (letters[axis] == '-' && axes[axis].size != 1) {
      return absl::InvalidArgumentError(
          absl::StrFormat("--axes %s leaves out axis %d of %s elements", letters, axis, shape));
    }
  }
  return *layout;
}

// Returns "element_size_um", one number for each axis of space, slowest first. None without it, or
// if it makes no sense and the rules have other distances.
absl::StatusOr<std::vector<double>> ElementSizes(hid_t dataset, const GridRules& rules) {
  constexpr char kName[] = "element_size_um";
  if (H5Aexists(dataset, kName) <= 0) {
    return std::vector<double>();
  }
  std::vector<double> sizes = Hdf5Numbers(dataset, kName);
  const bool is_good =
      sizes.size() == 3 && std::all_of(sizes.begin(), sizes.end(),
                                       [](double size) { return std::isfinite(size) && size > 0; });
  if (is_good) {
    return sizes;
  }
  if (rules.has_spacing) {
    return std::vector<double>();
  }
  return NoSampleDistance(
      "",
      absl::StrFormat(
          "its attribute %s has %s in place of three distances, of z, y and x", kName,
          sizes.size() == 3 ? absl::StrJoin(sizes, ", ") : absl::StrCat(sizes.size(), " numbers")));
}

}  // namespace

absl::StatusOr<std::vector<CfAxis>> Hdf5AxesOf(const NamedHdf5Dataset& named) {
  const hid_t dataset = named.dataset.get();
  std::vector<CfAxis> axes;
  for (const std::int64_t size : Hdf5DimsOf(dataset)) {
    axes.push_back({.name = "", .size = size});
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const bool is_nexus, TakeNexusAxes(named, &axes));
  if (is_nexus) {
    return axes;
  }
  std::vector<std::string> labels = Hdf5Texts(dataset, "DIMENSION_LABELS");
  labels.resize(axes.size());
  for (std::size_t i = 0; i < axes.size(); ++i) {
    axes[i].name = labels[i];
    const Hdf5Handle scale = Hdf5ScaleOf(dataset, i, axes.size());
    if (scale.is_valid()) {
      // A label that means nothing gives way to the name of the scale.
      axes[i].name = AxisLetterOf(labels[i]) != '?' ? labels[i] : Hdf5ScaleName(scale.get());
      ISOSCOPE_RETURN_IF_ERROR(TakeCoordinates(scale.get(), &axes[i]));
    }
  }
  const std::vector<std::string> names = NamesInOneAttribute(dataset, axes.size());
  const bool is_named = std::all_of(axes.begin(), axes.end(),
                                    [](const CfAxis& axis) { return CfLetterOf(axis) != '?'; });
  for (std::size_t i = 0; i < names.size() && !is_named; ++i) {
    axes[i].name = names[i];
  }
  return axes;
}

absl::StatusOr<Hdf5Layout> Hdf5LayoutOf(const std::vector<CfAxis>& axes, const std::string& letters,
                                        const std::string& name) {
  std::vector<std::int64_t> dims;
  dims.reserve(axes.size());
  for (const CfAxis& axis : axes) {
    dims.push_back(axis.size);
  }
  const std::string shape = absl::StrJoin(dims, " x ");
  if (!letters.empty()) {
    return LayoutAsGiven(axes, letters, shape);
  }
  if (auto layout = LayoutOfLetters(LettersByName(axes)); layout.has_value()) {
    return *layout;
  }
  if (const auto plain = PlainAxisOrder(dims); plain.has_value()) {
    return Hdf5Layout{
        .order = *plain,
        .roles = {.space = {plain->z, plain->y, plain->x}, .letters = {'Z', 'Y', 'X'}}};
  }
  const std::string choices = AxisChoices(dims.size());
  return absl::InvalidArgumentError(
      choices.empty()
          ? absl::StrFormat("%d axes (%s elements); expected 3 to 5", dims.size(), shape)
          : absl::StrFormat("%d axes (%s elements), and no attribute says what they mean: %s; say "
                            "it, slowest first (T time, C components), as in `isoscope partition "
                            "%s --axes %s --output DIR`",
                            dims.size(), shape, choices, base::ShellWord(name),
                            choices.substr(0, choices.find_first_of(", "))));
}

absl::StatusOr<Hdf5Grid> Hdf5GridOf(const NamedHdf5Dataset& named, const std::vector<CfAxis>& axes,
                                    const CfRoles& roles, bool takes_uneven,
                                    const GridRules& rules) {
  std::vector<CfAxis> placed = axes;
  for (CfAxis& axis : placed) {
    axis.positive = axis.positive.empty() ? "up" : axis.positive;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> sizes,
                            ElementSizes(named.dataset.get(), rules));
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    CfAxis& axis = placed[roles.space[i]];
    if (axis.values.empty()) {
      axis.step = sizes[i];
      axis.units = "um";
      axis.fault = "";
    }
  }
  if (!takes_uneven) {
    ISOSCOPE_RETURN_IF_ERROR(CfGridOf(placed, roles, rules).status());
  }
  ISOSCOPE_ASSIGN_OR_RETURN(CfUnevenGrid uneven, CfUnevenGridOf(placed, roles, rules));
  return Hdf5Grid{.geometry = uneven.geometry,
                  .distances = std::move(uneven.distances),
                  .length_unit = CfLengthUnit(placed, roles)};
}

}  // namespace isoscope::source
