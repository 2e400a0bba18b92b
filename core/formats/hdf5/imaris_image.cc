// An Imaris 5.5 file:
//
//   /DataSetInfo/Image          X, Y, Z: samples; ExtMin0, ExtMax0, ...: outer borders of the first
//                               and the last sample along x, y and z; Unit
//   /DataSetInfo/Channel 0      Name
//   /DataSetInfo/TimeInfo       TimePoint1, ...: "2020-06-22 10:00:00.500", the first step has 1
//   /DataSet/ResolutionLevel 0/TimePoint 0/Channel 0
//     Data                      [z][y][x], filled up to whole chunks
//
// All attributes are texts, stored as arrays of single characters. Lower resolutions lie in further
// groups and are passed over.
//
// Source: https://imaris.oxinst.com/support/imaris-file-format, "Imaris 5.5 File Format".

#include <cmath>
#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/civil_time.h"

#include "core/base/status_macros.h"
#include "core/formats/hdf5/hdf5_mesh.h"
#include "core/source/grid/stack_layout.h"
#include "hdf5.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxImarisSteps = 100'000;
constexpr std::int64_t kMaxImarisChannels = 4096;

// A text of single characters; "" if there is no such attribute.
std::string ImarisText(hid_t object, const std::string& attribute) {
  constexpr hssize_t kMaxCharacters = 4096;
  if (object < 0 || H5Aexists(object, attribute.c_str()) <= 0) {
    return "";
  }
  const Hdf5Handle opened(H5Aopen(object, attribute.c_str(), H5P_DEFAULT), H5Aclose);
  const Hdf5Handle space(H5Aget_space(opened.get()), H5Sclose);
  const Hdf5Handle type(H5Aget_type(opened.get()), H5Tclose);
  const hssize_t count = H5Sget_simple_extent_npoints(space.get());
  if (H5Tget_class(type.get()) != H5T_STRING || H5Tis_variable_str(type.get()) != 0 ||
      H5Tget_size(type.get()) != 1 || count < 1 || count > kMaxCharacters) {
    return "";
  }
  std::string text(static_cast<std::size_t>(count), '\0');
  if (H5Aread(opened.get(), type.get(), text.data()) < 0) {
    return "";
  }
  return std::string(absl::StripAsciiWhitespace(text.substr(0, text.find('\0'))));
}

absl::StatusOr<double> ImarisNumber(hid_t object, const std::string& attribute) {
  const std::string text = ImarisText(object, attribute);
  double number = 0;
  if (!absl::SimpleAtod(text, &number) || !std::isfinite(number)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "Imaris: the attribute %s of /DataSetInfo/Image is \"%s\"; expected a number", attribute,
        text));
  }
  return number;
}

absl::StatusOr<volume::GridGeometry> ImarisGrid(hid_t image) {
  volume::GridGeometry grid;
  for (int axis = 0; axis < 3; ++axis) {
    const std::string letter(1, "XYZ"[axis]);
    const std::string text = ImarisText(image, letter);
    if (!absl::SimpleAtoi(text, &grid.sample_dims[axis]) || grid.sample_dims[axis] < 1) {
      return absl::InvalidArgumentError(
          absl::StrFormat("Imaris: the attribute %s of /DataSetInfo/Image is \"%s\"; expected a "
                          "number of samples",
                          letter, text));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const double begin,
                              ImarisNumber(image, absl::StrCat("ExtMin", axis)));
    ISOSCOPE_ASSIGN_OR_RETURN(const double end, ImarisNumber(image, absl::StrCat("ExtMax", axis)));
    grid.spacing[axis] = (end - begin) / static_cast<double>(grid.sample_dims[axis]);
    if (!(grid.spacing[axis] > 0)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "Imaris: ExtMin%d is %g and ExtMax%d is %g; expected the lower border, then the upper",
          axis, begin, axis, end));
    }
    grid.origin[axis] = begin + grid.spacing[axis] / 2;
  }
  return grid;
}

// Seconds since an arbitrary start; not set if the text is no time.
std::optional<double> ImarisSeconds(const std::string& text) {
  const std::size_t dot = text.find('.');
  absl::CivilSecond second;
  double fraction = 0;
  std::string whole = text.substr(0, dot);
  if (const std::size_t blank = whole.find(' '); blank != std::string::npos) {
    whole[blank] = 'T';
  }
  if (!absl::ParseCivilTime(whole, &second) ||
      (dot != std::string::npos && !absl::SimpleAtod("0" + text.substr(dot), &fraction))) {
    return std::nullopt;
  }
  return static_cast<double>(second - absl::CivilSecond(2000, 1, 1)) + fraction;
}

// Seconds since the first step; numbers of steps if the file does not tell ascending times.
void TakeImarisTimes(hid_t file, std::int64_t steps, Hdf5MeshFile* meshes) {
  const Hdf5Handle info(H5Gopen2(file, "DataSetInfo/TimeInfo", H5P_DEFAULT), H5Gclose);
  std::vector<double>& times = meshes->info.times;
  double first = 0;
  for (std::int64_t i = 0; i < steps; ++i) {
    const std::optional<double> time =
        ImarisSeconds(ImarisText(info.get(), absl::StrCat("TimePoint", i + 1)));
    first = i == 0 ? time.value_or(0) : first;
    if (!time.has_value() || (i > 0 && !(*time - first > times.back()))) {
      times.clear();
      break;
    }
    times.push_back(*time - first);
  }
  if (steps == 1) {
    times.clear();
  }
  const bool has_times = !times.empty();
  meshes->info.time_unit = has_times ? "s" : "";
  for (std::int64_t i = 0; !has_times && steps > 1 && i < steps; ++i) {
    times.push_back(static_cast<double>(i));
  }
}

std::string ImarisDataPath(std::int64_t step, std::int64_t channel) {
  return absl::StrFormat("/DataSet/ResolutionLevel 0/TimePoint %d/Channel %d/Data", step, channel);
}

// Counts the links "TimePoint 0", "TimePoint 1", ...
std::int64_t CountLinks(hid_t group, const std::string& stem, std::int64_t most) {
  std::int64_t count = 0;
  while (group >= 0 && count <= most &&
         H5Lexists(group, absl::StrCat(stem, count).c_str(), H5P_DEFAULT) > 0) {
    ++count;
  }
  return count;
}

}  // namespace

bool IsImaris(hid_t file) {
  return H5Aexists(file, "ImarisVersion") > 0 || H5Aexists(file, "ImarisDataSet") > 0;
}

absl::StatusOr<Hdf5MeshFile> FindImarisImage(hid_t file) {
  const Hdf5Handle image(H5Gopen2(file, "DataSetInfo/Image", H5P_DEFAULT), H5Gclose);
  const Hdf5Handle level(H5Gopen2(file, "DataSet/ResolutionLevel 0", H5P_DEFAULT), H5Gclose);
  const Hdf5Handle first(H5Gopen2(level.get(), "TimePoint 0", H5P_DEFAULT), H5Gclose);
  const std::int64_t steps = CountLinks(level.get(), "TimePoint ", kMaxImarisSteps);
  const std::int64_t channels = CountLinks(first.get(), "Channel ", kMaxImarisChannels);
  if (!image.is_valid() || steps < 1 || channels < 1 || steps > kMaxImarisSteps ||
      channels > kMaxImarisChannels) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "an Imaris file with %d steps and %d channels; expected 1 to %d steps and 1 to %d channels "
        "below /DataSet/ResolutionLevel 0, and /DataSetInfo/Image",
        steps, channels, kMaxImarisSteps, kMaxImarisChannels));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::GridGeometry grid, ImarisGrid(image.get()));
  Hdf5MeshFile meshes;
  const std::string unit = ImarisText(image.get(), "Unit");
  const std::optional<LengthUnit> known = LengthUnitOf(unit);
  meshes.info.length_unit = known.has_value() ? known->name : unit;
  TakeImarisTimes(file, steps, &meshes);
  std::set<std::string> names;
  for (std::int64_t channel = 0; channel < channels; ++channel) {
    const Hdf5Handle info(
        H5Gopen2(file, absl::StrFormat("DataSetInfo/Channel %d", channel).c_str(), H5P_DEFAULT),
        H5Gclose);
    std::string name = ImarisText(info.get(), "Name");
    if (name.empty() || name == "(name not specified)" || !names.insert(name).second) {
      name = absl::StrCat("channel ", channel);
      names.insert(name);
    }
    Hdf5MeshField field{.field = {.name = std::move(name)}, .geometry = grid, .is_filled_up = true};
    for (std::int64_t step = 0; step < steps; ++step) {
      field.volumes.push_back(
          {.dataset = ImarisDataPath(step, channel), .axes = AxisOrder{.z = 0, .y = 1, .x = 2}});
    }
    meshes.fields.push_back(std::move(field));
  }
  return meshes;
}

}  // namespace isoscope::source
