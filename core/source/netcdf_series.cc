// The child process says in texts "key=value" which variables there are; nothing in them is taken
// for granted:
//
//   times=0 0.05 0.1 ...     none if there is no time
//   time_unit=, length_unit=
//   field=u                  begins a field
//   variable=3               its number among the volumes of the file
//   components=1
//   unit=, long_name=
//
// A volume is then asked for by its part: "3 0 2", variable, step and component.

#include "core/source/netcdf_series.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <set>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/source/located_series.h"
#include "core/source/netcdf_file.h"
#include "core/source/netcdf_source.h"
#include "core/source/walled_source.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxNetcdfSteps = 100'000;
constexpr std::int64_t kMaxNetcdfComponents = 4096;

// ---- The child. ---------------------------------------------------------------------------------

// Whether both lie on one grid, in the same order, with the same steps.
bool AreOnOneGrid(const NetcdfVariable& a, const NetcdfVariable& b) {
  for (std::size_t i = 0; i < 3; ++i) {
    if (a.dimensions[a.roles.space[i]] != b.dimensions[b.roles.space[i]]) {
      return false;
    }
  }
  return a.roles.time.has_value() == b.roles.time.has_value() &&
         (!a.roles.time.has_value() || a.dimensions[*a.roles.time] == b.dimensions[*b.roles.time]);
}

// The variable whose grid is read; REQUIRES: at least one.
const NetcdfVariable& ChooseGrid(const std::vector<NetcdfVariable>& volumes,
                                 const std::string& part) {
  const NetcdfVariable* chosen = nullptr;
  std::pair<bool, std::size_t> best{};
  for (const NetcdfVariable& candidate : volumes) {
    if (candidate.name == part || absl::StartsWith(part, absl::StrCat(candidate.name, ":"))) {
      return candidate;
    }
    const auto alike = static_cast<std::size_t>(
        std::count_if(volumes.begin(), volumes.end(),
                      [&](const NetcdfVariable& other) { return AreOnOneGrid(candidate, other); }));
    const std::pair<bool, std::size_t> rank{candidate.roles.time.has_value(), alike};
    if (chosen == nullptr || rank > best) {
      chosen = &candidate;
      best = rank;
    }
  }
  return *chosen;
}

absl::StatusOr<std::vector<std::string>> DescribeNetcdf(const std::string& path,
                                                        const std::string& part) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<NetcdfFile> file, NetcdfFile::Open(path));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<NetcdfVariable> volumes, file->Volumes());
  if (volumes.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(path,
                     ": no variable of numbers with axes Z, Y and X of 2 samples or more, by CF's "
                     "attributes (axis, units, standard_name, positive) or the dimensions' names"));
  }
  const NetcdfVariable& chosen = ChooseGrid(volumes, part);
  std::vector<std::string> texts{
      absl::StrCat("length_unit=", CfLengthUnit(chosen.axes, chosen.roles))};
  if (chosen.roles.time.has_value()) {
    const CfAxis& time = chosen.axes[*chosen.roles.time];
    if (time.size < 1 || time.size > kMaxNetcdfSteps) {
      return absl::InvalidArgumentError(absl::StrFormat("%s: %d steps of time; expected 1 to %d",
                                                        path, time.size, kMaxNetcdfSteps));
    }
    const auto times = CfTimesOf(time);
    if (!times.ok()) {
      return absl::Status(times.status().code(),
                          absl::StrCat(path, ": ", times.status().message()));
    }
    texts.push_back(
        absl::StrCat("times=", absl::StrJoin(*times, " ", [](std::string* out, double value) {
                       absl::StrAppendFormat(out, "%.17g", value);
                     })));
    texts.push_back(absl::StrCat("time_unit=", time.units));
  }
  for (std::size_t i = 0; i < volumes.size(); ++i) {
    const NetcdfVariable& volume = volumes[i];
    if (!AreOnOneGrid(chosen, volume)) {
      continue;
    }
    texts.push_back(absl::StrCat("field=", volume.name));
    texts.push_back(absl::StrCat("variable=", i));
    texts.push_back(absl::StrCat("components=", volume.roles.component.has_value()
                                                    ? volume.axes[*volume.roles.component].size
                                                    : 1));
    texts.push_back(absl::StrCat("unit=", file->Text(volume, {"units"})));
    texts.push_back(absl::StrCat("long_name=", file->Text(volume, {"long_name", "standard_name"})));
  }
  return texts;
}

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenNetcdfPart(const std::string& path,
                                                             const std::string& part) {
  std::array<std::int64_t, 3> numbers{};
  const std::vector<std::string> words = absl::StrSplit(part, ' ');
  ISOSCOPE_CHECK(words.size() == numbers.size());
  for (std::size_t i = 0; i < words.size(); ++i) {
    ISOSCOPE_CHECK(absl::SimpleAtoi(words[i], &numbers[i]));
  }
  const auto [variable, step, component] = numbers;
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<NetcdfFile> file, NetcdfFile::Open(path));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<NetcdfVariable> volumes, file->Volumes());
  if (variable < static_cast<std::int64_t>(volumes.size())) {
    const NetcdfVariable& wanted = volumes[static_cast<std::size_t>(variable)];
    const CfRoles& roles = wanted.roles;
    if (step < (roles.time.has_value() ? wanted.axes[*roles.time].size : 1) &&
        component < (roles.component.has_value() ? wanted.axes[*roles.component].size : 1)) {
      return OpenNetcdfVolume(std::move(file), wanted, step, component);
    }
  }
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: no variable %d with step %d and component %d: it has changed", path,
                      variable, step, component));
}

// ---- The parent. --------------------------------------------------------------------------------

constexpr WalledLibrary kNetcdf = {
    .name = "netCDF", .open = OpenNetcdfPart, .find_files = nullptr, .describe = DescribeNetcdf};

struct NetcdfDescription {
  std::vector<SourceField> fields;
  std::vector<std::int64_t> variables;  // by field
  std::vector<double> times;
  std::string time_unit;
  std::string length_unit;
};

// False if the text makes no sense.
bool TakeText(const std::string& text, NetcdfDescription* description) {
  const std::pair<std::string, std::string> pair = absl::StrSplit(text, absl::MaxSplits('=', 1));
  const auto& [key, value] = pair;
  if (key == "length_unit" || key == "time_unit") {
    (key == "time_unit" ? description->time_unit : description->length_unit) = value;
    return true;
  }
  if (key == "times") {
    std::vector<double>& times = description->times;
    for (const absl::string_view word : absl::StrSplit(value, ' ', absl::SkipEmpty())) {
      double& time = times.emplace_back();
      if (!absl::SimpleAtod(word, &time) || !std::isfinite(time) ||
          (times.size() > 1 && !(time > times[times.size() - 2]))) {
        return false;
      }
    }
    return static_cast<std::int64_t>(times.size()) <= kMaxNetcdfSteps;
  }
  if (key == "field") {
    description->fields.push_back({.name = value});
    description->variables.push_back(0);
    return !value.empty();
  }
  if (description->fields.empty()) {
    return false;
  }
  SourceField& field = description->fields.back();
  if (key == "variable") {
    return absl::SimpleAtoi(value, &description->variables.back()) &&
           description->variables.back() >= 0;
  }
  if (key == "components") {
    std::int64_t count = 0;
    const bool is_count =
        absl::SimpleAtoi(value, &count) && count >= 1 && count <= kMaxNetcdfComponents;
    field.components = ComponentNames(is_count ? count : 1);
    return is_count;
  }
  (key == "unit" ? field.unit : field.long_name) = value;
  return key == "unit" || key == "long_name";
}

bool HasUniqueNames(const std::vector<SourceField>& fields) {
  std::set<std::string> names;
  return std::all_of(fields.begin(), fields.end(),
                     [&](const SourceField& field) { return names.insert(field.name).second; });
}

class NetcdfSeries final : public VolumeSeries {
 public:
  NetcdfSeries(std::string path, NetcdfDescription description)
      : path_(std::move(path)), description_(std::move(description)) {}

  [[nodiscard]] const std::string& name() const override { return path_; }
  [[nodiscard]] const std::vector<SourceField>& fields() const override {
    return description_.fields;
  }
  [[nodiscard]] const std::vector<double>& times() const override { return description_.times; }
  [[nodiscard]] const std::string& time_unit() const override { return description_.time_unit; }
  [[nodiscard]] const std::string& length_unit() const override { return description_.length_unit; }

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    return OpenWalled(kNetcdf, path_,
                      absl::StrCat(description_.variables[static_cast<std::size_t>(field)], " ",
                                   step, " ", component));
  }

 private:
  const std::string path_;
  const NetcdfDescription description_;
};

}  // namespace

bool IsNetcdf(absl::string_view head) {
  constexpr absl::string_view kHdf5("\x89HDF\r\n\x1a\n", 8);
  return absl::StartsWith(head, kHdf5) || (absl::StartsWith(head, "CDF") && head.size() > 3 &&
                                           (head[3] == 1 || head[3] == 2 || head[3] == 5));
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenNetcdfSeries(const std::string& file,
                                                               const std::string& part) {
  constexpr std::size_t kMaxPart = 255;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> texts,
                            DescribeWalled(kNetcdf, file, part.substr(0, kMaxPart)));
  NetcdfDescription description;
  const bool makes_sense = std::all_of(texts.begin(), texts.end(), [&](const std::string& text) {
    return TakeText(text, &description);
  });
  if (!makes_sense || description.fields.empty() || !HasUniqueNames(description.fields)) {
    return absl::DataLossError(
        absl::StrCat(file, ": what netCDF says of it makes no sense: the file is damaged"));
  }
  return std::make_unique<NetcdfSeries>(file, std::move(description));
}

}  // namespace isoscope::source
