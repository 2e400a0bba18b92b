// An openPMD file, with basePath="/data/%T/" and meshesPath="fields/":
//
//   /data/100                   an iteration; time, timeUnitSI
//     fields/rho                a scalar record: a dataset
//     fields/E                  a record of components: a group of datasets x, y, z
//
// A record has geometry ("cartesian"), dataOrder ("C"), axisLabels ("z", "y", "x"), gridSpacing and
// gridGlobalOffset by label, gridUnitSI, unitDimension; a component position (within a cell, by
// label) and unitSI. Sample i of an axis lies at
//
//   (gridGlobalOffset + (i + position) * gridSpacing) * gridUnitSI
//
// Each iteration says all of this again. A series has one grid and one unit, so that they must not
// change: a moving window changes gridGlobalOffset.
//
// A constant component is a group with the attributes value and shape in place of a dataset.
//
// Source: openPMD standard 1.1 and 2.0, https://github.com/openPMD/openPMD-standard.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/strip.h"

#include "core/base/shell_word.h"
#include "core/base/status_macros.h"
#include "core/formats/hdf5/hdf5_attributes.h"
#include "core/formats/hdf5/hdf5_dataset.h"
#include "core/formats/hdf5/hdf5_mesh.h"
#include "hdf5.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kMaxOpenPmdSteps = 100'000;
constexpr std::size_t kMaxWhy = 600;  // of an error, bytes

struct OpenPmdStep {
  std::int64_t number = 0;
  std::string path;  // ends with '/'
  double time = 0;
};

double NumberOr(hid_t object, const char* attribute, double fallback) {
  const std::vector<double> numbers = Hdf5Numbers(object, attribute);
  return numbers.empty() ? fallback : numbers[0];
}

// The iterations, by time; by their numbers if one of them does not say its time in seconds.
absl::StatusOr<std::vector<OpenPmdStep>> FindOpenPmdSteps(hid_t file, bool* has_times) {
  *has_times = true;
  std::string base = Hdf5Text(file, {"basePath"});
  if (base.empty()) {
    base = "/data/%T/";
  }
  const std::size_t mark = base.find("%T");
  if (mark == std::string::npos || mark == 0) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "openPMD's basePath is \"%s\"; expected %%T in it, as in /data/%%T/", base));
  }
  const Hdf5Handle group(H5Gopen2(file, base.substr(0, mark).c_str(), H5P_DEFAULT), H5Gclose);
  std::vector<OpenPmdStep> steps;
  for (const std::string& name : Hdf5NamesIn(group.get())) {
    OpenPmdStep step{.path = absl::StrReplaceAll(base, {{"%T", name}})};
    const Hdf5Handle iteration(H5Gopen2(file, step.path.c_str(), H5P_DEFAULT), H5Gclose);
    if (!absl::SimpleAtoi(name, &step.number) || !iteration.is_valid()) {
      continue;
    }
    const std::vector<double> time = Hdf5Numbers(iteration.get(), "time");
    const std::vector<double> unit = Hdf5Numbers(iteration.get(), "timeUnitSI");
    *has_times = *has_times && time.size() == 1 && unit.size() == 1;
    step.time = *has_times ? time[0] * unit[0] : 0;
    steps.push_back(std::move(step));
  }
  for (OpenPmdStep& step : steps) {
    step.time = *has_times ? step.time : static_cast<double>(step.number);
  }
  std::sort(steps.begin(), steps.end(),
            [](const OpenPmdStep& a, const OpenPmdStep& b) { return a.number < b.number; });
  if (steps.empty() || steps.size() > kMaxOpenPmdSteps) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%d iterations of openPMD below %s; expected 1 to %d", steps.size(), base,
                        kMaxOpenPmdSteps));
  }
  for (std::size_t i = 0; i < steps.size(); ++i) {
    if (!std::isfinite(steps[i].time) || (i > 0 && !(steps[i].time > steps[i - 1].time))) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "iteration %d has the time %g, behind %g; expected finite times that ascend",
          steps[i].number, steps[i].time, steps[i > 0 ? i - 1 : 0].time));
    }
  }
  return steps;
}

// "kg m s^-2" of the powers of length, mass, time, current, temperature, amount, light; with
// unitSI in front if it is not 1. "" without powers.
std::string OpenPmdUnit(hid_t record, hid_t component) {
  constexpr std::array<const char*, 7> kUnits{"m", "kg", "s", "A", "K", "mol", "cd"};
  const std::vector<double> powers = Hdf5Numbers(record, "unitDimension");
  const double scale = NumberOr(component, "unitSI", 1);
  std::string unit = scale == 1 ? "" : absl::StrFormat("%g", scale);
  for (std::size_t i = 0; i < powers.size() && i < kUnits.size(); ++i) {
    if (powers[i] != 0) {
      absl::StrAppend(&unit, unit.empty() ? "" : " ", kUnits[i],
                      powers[i] == 1 ? "" : absl::StrFormat("^%g", powers[i]));
    }
  }
  return unit;
}

// The three numbers of an attribute, or `fallback` if there is none. INVALID_ARGUMENT: another
// count; none, without a fallback; not finite.
absl::StatusOr<std::vector<double>> OpenPmdNumbers(hid_t object, const char* attribute,
                                                   bool may_be_one,
                                                   std::optional<double> fallback = std::nullopt) {
  std::vector<double> numbers = Hdf5Numbers(object, attribute);
  if (numbers.empty() && fallback.has_value()) {
    numbers.resize(3, *fallback);
  }
  if (may_be_one && numbers.size() == 1) {
    numbers.resize(3, numbers[0]);
  }
  if (numbers.size() != 3) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%d numbers in %s; expected %s", numbers.size(), attribute, may_be_one ? "1 or 3" : "3"));
  }
  for (const double number : numbers) {
    if (!std::isfinite(number)) {
      return absl::InvalidArgumentError(absl::StrFormat("%g in %s", number, attribute));
    }
  }
  return numbers;
}

// Returns the grid of a component of a record. INVALID_ARGUMENT, without the record's name: it is
// no grid in space, or the file does not tell it.
absl::StatusOr<volume::GridGeometry> OpenPmdGrid(hid_t record, hid_t component,
                                                 const std::vector<std::int64_t>& dims) {
  const std::string kind = Hdf5Text(record, {"geometry"});
  std::vector<std::string> labels = Hdf5Texts(record, "axisLabels");
  if ((!kind.empty() && kind != "cartesian") || dims.size() != 3 || labels.size() != 3) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "the geometry \"%s\", %d axes and %d axisLabels", kind, dims.size(), labels.size()));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<double> spacing,
                            OpenPmdNumbers(record, "gridSpacing", false));
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<double> offset,
                            OpenPmdNumbers(record, "gridGlobalOffset", false, 0));
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<double> position,
                            OpenPmdNumbers(component, "position", false, 0));
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<double> unit, OpenPmdNumbers(record, "gridUnitSI", true));
  if (Hdf5Text(record, {"dataOrder"}) == "F") {
    for (std::vector<double>* numbers : {&spacing, &offset, &position, &unit}) {
      std::reverse(numbers->begin(), numbers->end());
    }
    std::reverse(labels.begin(), labels.end());
  }
  volume::GridGeometry geometry;
  std::string seen;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::string& label = labels[axis];
    if ((label != "x" && label != "y" && label != "z") || absl::StrContains(seen, label)) {
      return absl::InvalidArgumentError(absl::StrFormat("the axisLabel \"%s\"", label));
    }
    seen += label;
    const int world = label[0] - 'x';
    const std::size_t index = 2 - axis;  // the last axis is the fastest
    const double distance = spacing[axis] * unit[axis];
    if (distance == 0) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "gridSpacing %g times gridUnitSI %g along %s", spacing[axis], unit[axis], label));
    }
    geometry.sample_dims[static_cast<int>(index)] = dims[axis];
    geometry.spacing[static_cast<int>(index)] = std::abs(distance);
    geometry.origin[world] = (offset[axis] + position[axis] * spacing[axis]) * unit[axis];
    math::Vec3d direction{0, 0, 0};
    direction[world] = distance < 0 ? -1 : 1;
    geometry.direction.columns[index] = direction;
  }
  return geometry;
}

bool IsOpenPmdComponent(hid_t object) {
  return H5Iget_type(object) == H5I_DATASET || FindHdf5Constant(object).has_value();
}

// Adds a component of a record, as a field of its own. Returns why it is none, else "".
std::string AddOpenPmdField(hid_t record, const std::string& record_path, hid_t component,
                            const std::string& name, const std::string& path,
                            const std::vector<OpenPmdStep>& steps, Hdf5MeshFile* meshes) {
  Hdf5MeshField field{.field = {.name = name, .unit = OpenPmdUnit(record, component)},
                      .geometry = {}};
  const std::optional<Hdf5Constant> constant = FindHdf5Constant(component);
  if (!constant.has_value() && !Hdf5SampleTypeOf(component).ok()) {
    return absl::StrCat("; ", name, " has no numbers");
  }
  const auto grid =
      OpenPmdGrid(record, component, constant.has_value() ? constant->dims : Hdf5DimsOf(component));
  if (!grid.ok()) {
    return absl::StrCat("; ", name, " has ", grid.status().message());
  }
  field.geometry = *grid;
  for (const OpenPmdStep& step : steps) {
    field.volumes.push_back({.dataset = absl::StrCat(step.path, path),
                             .axes = AxisOrder{.z = 0, .y = 1, .x = 2},
                             .record = absl::StrCat(step.path, record_path)});
  }
  meshes->fields.push_back(std::move(field));
  return "";
}

// The attributes of an iteration for grid and unit; a missing attribute has its default.
struct OpenPmdAttributes {
  std::map<std::string, std::vector<std::string>> texts{};
  std::map<std::string, std::vector<double>> numbers{};
};

OpenPmdAttributes ReadOpenPmdAttributes(hid_t record, hid_t component) {
  const auto numbers = [](hid_t object, const char* name, std::size_t count, double fallback) {
    std::vector<double> read = Hdf5Numbers(object, name);
    if (read.empty()) {
      read.assign(count, fallback);
    }
    return read;
  };
  const auto text = [record](const char* name, const char* fallback) {
    const std::string read = Hdf5Text(record, {name});
    return std::vector<std::string>{read.empty() ? fallback : read};
  };
  OpenPmdAttributes attributes;
  attributes.texts = {{"geometry", text("geometry", "cartesian")},
                      {"dataOrder", text("dataOrder", "C")},
                      {"axisLabels", Hdf5Texts(record, "axisLabels")}};
  attributes.numbers = {{"gridSpacing", Hdf5Numbers(record, "gridSpacing")},
                        {"gridGlobalOffset", numbers(record, "gridGlobalOffset", 3, 0)},
                        {"gridUnitSI", Hdf5Numbers(record, "gridUnitSI")},
                        {"unitDimension", numbers(record, "unitDimension", 7, 0)},
                        {"position", numbers(component, "position", 3, 0)},
                        {"unitSI", numbers(component, "unitSI", 1, 1)}};
  if (std::vector<double>& unit = attributes.numbers["gridUnitSI"]; unit.size() == 1) {
    unit.resize(3, unit[0]);
  }
  return attributes;
}

// "" if both say the same; else the first attribute that differs: "position of 0 0 0, but ... of
// 0.5 0.5 0.5".
std::string OpenPmdDifference(const OpenPmdAttributes& a, const OpenPmdAttributes& b,
                              const std::string& name_of_b) {
  const auto described = [&](const std::string& name, const std::string& of_a,
                             const std::string& of_b) {
    return absl::StrFormat("%s of %s, but %s of %s", name, of_a.empty() ? "nothing" : of_a,
                           name_of_b, of_b.empty() ? "nothing" : of_b);
  };
  for (const auto& [name, texts] : a.texts) {
    if (texts != b.texts.at(name)) {
      return described(name, absl::StrJoin(texts, " "), absl::StrJoin(b.texts.at(name), " "));
    }
  }
  const auto joined = [](const std::vector<double>& numbers, int digits) {
    return absl::StrJoin(numbers, " ", [digits](std::string* out, double number) {
      absl::StrAppendFormat(out, "%.*g", digits, number);
    });
  };
  constexpr int kShort = 6;
  constexpr int kExact = 17;
  for (const auto& [name, numbers] : a.numbers) {
    const std::vector<double>& others = b.numbers.at(name);
    if (numbers != others) {
      const int digits = joined(numbers, kShort) == joined(others, kShort) ? kExact : kShort;
      return described(name, joined(numbers, digits), joined(others, digits));
    }
  }
  return "";
}

// Makes one field of the fields from `first` on, if they lie on one grid with one unit.
void JoinOpenPmdComponents(const std::string& record, std::size_t first,
                           const std::vector<std::string>& names, Hdf5MeshFile* meshes) {
  std::vector<Hdf5MeshField>& fields = meshes->fields;
  const std::size_t count = fields.size() - first;
  if (count < 2 || count != names.size()) {
    return;
  }
  for (std::size_t i = first; i < fields.size(); ++i) {
    if (fields[i].geometry != fields[first].geometry ||
        fields[i].field.unit != fields[first].field.unit) {
      return;
    }
  }
  Hdf5MeshField joined = fields[first];
  joined.field.name = record;
  joined.field.components = names;
  joined.volumes.clear();
  for (std::size_t step = 0; step < fields[first].volumes.size(); ++step) {
    for (std::size_t i = first; i < fields.size(); ++i) {
      joined.volumes.push_back(fields[i].volumes[step]);
    }
  }
  fields.resize(first);
  fields.push_back(std::move(joined));
}

}  // namespace

std::optional<Hdf5Constant> FindHdf5Constant(hid_t object) {
  constexpr double kMaxSize = 1e9;
  const std::vector<double> value = Hdf5Numbers(object, "value");
  Hdf5Constant constant;
  for (const double size : Hdf5Numbers(object, "shape")) {
    if (!(size >= 1 && size <= kMaxSize)) {
      return std::nullopt;
    }
    constant.dims.push_back(static_cast<std::int64_t>(size));
  }
  if (H5Iget_type(object) != H5I_GROUP || value.size() != 1 || constant.dims.empty()) {
    return std::nullopt;
  }
  const Hdf5Handle attribute(H5Aopen(object, "value", H5P_DEFAULT), H5Aclose);
  const Hdf5Handle type(H5Aget_type(attribute.get()), H5Tclose);
  constant.value = value[0];
  constant.is_single =
      H5Tget_class(type.get()) == H5T_FLOAT && H5Tget_size(type.get()) <= sizeof(float);
  return constant;
}

absl::Status CheckOpenPmdSteps(hid_t file, const std::string& path, const Hdf5MeshField& field,
                               std::size_t begin, std::size_t end) {
  const std::size_t components = field.field.components.size();
  if (components == 0 || field.volumes.empty() || field.volumes.front().record.empty()) {
    return absl::OkStatus();
  }
  const auto read = [file](const Hdf5MeshVolume& volume) -> std::optional<OpenPmdAttributes> {
    const Hdf5Handle record(H5Oopen(file, volume.record.c_str(), H5P_DEFAULT), H5Oclose);
    const Hdf5Handle component(H5Oopen(file, volume.dataset.c_str(), H5P_DEFAULT), H5Oclose);
    return record.is_valid() && component.is_valid()
               ? std::optional(ReadOpenPmdAttributes(record.get(), component.get()))
               : std::nullopt;  // whoever opens it gets an error
  };
  std::vector<std::optional<OpenPmdAttributes>> first;  // of the first step
  for (std::size_t i = 0; i < components && i < field.volumes.size(); ++i) {
    first.push_back(read(field.volumes[i]));
  }
  for (std::size_t i = std::max(begin, first.size()); i < std::min(end, field.volumes.size());
       ++i) {
    const Hdf5MeshVolume& volume = field.volumes[i];
    const std::size_t component = i % components;
    const auto own = first[component].has_value() ? read(volume) : std::nullopt;
    const std::string difference =
        own.has_value()
            ? OpenPmdDifference(*own, *first[component], field.volumes[component].dataset)
            : "";
    if (!difference.empty()) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s has %s: the iterations of a series have one grid and one unit; open one of them by "
          "its dataset, as %s with --spacing and --origin, or write each to a file of its own",
          volume.dataset, difference, base::ShellWord(absl::StrCat(path, ":", volume.dataset))));
    }
  }
  return absl::OkStatus();
}

absl::StatusOr<Hdf5MeshFile> FindOpenPmdMeshes(hid_t file) {
  bool has_times = true;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<OpenPmdStep> steps,
                            FindOpenPmdSteps(file, &has_times));
  Hdf5MeshFile meshes{.info = {.time_unit = has_times ? "s" : "", .length_unit = "m"}};
  for (const OpenPmdStep& step : steps) {
    meshes.info.times.push_back(step.time);
  }
  std::string folder = Hdf5Text(file, {"meshesPath"});
  if (folder.empty()) {
    folder = "meshes/";
  }
  const std::string first_path = absl::StrCat(steps.front().path, folder);
  const Hdf5Handle group(H5Gopen2(file, first_path.c_str(), H5P_DEFAULT), H5Gclose);
  std::string why;  // records are no meshes
  for (const std::string& name : Hdf5NamesIn(group.get())) {
    const Hdf5Handle record(H5Oopen(group.get(), name.c_str(), H5P_DEFAULT), H5Oclose);
    if (IsOpenPmdComponent(record.get())) {
      why += AddOpenPmdField(record.get(), folder + name, record.get(), name, folder + name, steps,
                             &meshes);
      continue;
    }
    const std::size_t first = meshes.fields.size();
    const std::vector<std::string> components = Hdf5NamesIn(record.get());
    for (const std::string& part : components) {
      const Hdf5Handle component(H5Oopen(record.get(), part.c_str(), H5P_DEFAULT), H5Oclose);
      if (IsOpenPmdComponent(component.get())) {
        why += AddOpenPmdField(record.get(), folder + name, component.get(),
                               absl::StrCat(name, "/", part), absl::StrCat(folder, name, "/", part),
                               steps, &meshes);
      }
    }
    JoinOpenPmdComponents(name, first, components, &meshes);
  }
  if (meshes.fields.empty()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("no mesh of openPMD below %s with three cartesian axes x, y and z%s",
                        first_path, why.substr(0, kMaxWhy)));
  }
  return meshes;
}

}  // namespace isoscope::source
