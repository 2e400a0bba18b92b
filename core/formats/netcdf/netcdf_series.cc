// The child finds the volumes of a file twice: to describe it, and to open one. A volume's number
// holds what both must agree on: the place of its variable among all arrays, and the letters that
// --axes gives its axes, as digits.
//
//   number = place * 6^12 + code     code: 0 if the file says the axes, else 1 + its digits
//   digits                           of "-TCZYX", one an axis, the first the most significant

#include "core/formats/netcdf/netcdf_series.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"

#include "core/base/printable.h"
#include "core/base/shell_word.h"
#include "core/base/status_macros.h"
#include "core/formats/netcdf/netcdf_file.h"
#include "core/formats/netcdf/netcdf_source.h"
#include "core/source/bytes/located_series.h"
#include "core/source/bytes/part_path.h"
#include "core/source/child/walled_series.h"
#include "core/source/child/walled_source.h"
#include "core/source/grid/axis_order.h"
#include "core/source/hdf5/hdf5_path.h"
#include "core/source/series_parts.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxNetcdfSteps = 100'000;
constexpr std::int64_t kMaxNetcdfComponents = 4096;

bool IsNetcdfNamed(const NetcdfVariable& variable, const std::string& part) {
  return variable.name == part || absl::StartsWith(part, absl::StrCat(variable.name, ":"));
}

// Returns true if both lie on one grid, in the same order, with the same steps. The attribute
// "coordinates" may give one dimension other coordinates, under another name, in another variable.
bool AreOnOneGrid(const NetcdfVariable& a, const NetcdfVariable& b) {
  const auto are_alike = [&](std::size_t i, std::size_t k) {
    return a.dimensions[i] == b.dimensions[k] && a.axes[i].name == b.axes[k].name &&
           a.axes[i].fault == b.axes[k].fault;
  };
  for (std::size_t i = 0; i < 3; ++i) {
    if (!are_alike(a.roles.space[i], b.roles.space[i])) {
      return false;
    }
  }
  return a.roles.time.has_value() == b.roles.time.has_value() &&
         (!a.roles.time.has_value() || are_alike(*a.roles.time, *b.roles.time));
}

// The variable whose grid is read; REQUIRES: at least one.
const NetcdfVariable& ChooseGrid(const std::vector<NetcdfVariable>& volumes,
                                 const std::string& part) {
  const NetcdfVariable* chosen = nullptr;
  std::pair<bool, std::size_t> best{};
  for (const NetcdfVariable& candidate : volumes) {
    if (IsNetcdfNamed(candidate, part)) {
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

// ---- The letters of --axes in parts and numbers. ------------------------------------------------

constexpr absl::string_view kNetcdfLetters = "-TCZYX";
constexpr std::size_t kMaxNetcdfLetters = 12;
constexpr std::int64_t kNetcdfCodes = 2'176'782'336;  // 6^12
constexpr absl::string_view kAxesMark = "--axes ";    // no name of a variable begins so

struct NetcdfRequest {
  std::string letters;  // "" if the file says the axes
  std::string part;     // "u:1"
};

std::string NetcdfRequestText(const std::string& letters, const std::string& part) {
  return letters.empty() ? part : absl::StrCat(kAxesMark, letters, " ", part);
}

NetcdfRequest ParseNetcdfRequest(absl::string_view text) {
  if (!absl::ConsumePrefix(&text, kAxesMark)) {
    return {.letters = "", .part = std::string(text)};
  }
  const std::size_t end = std::min(text.find(' '), text.size());
  return {.letters = std::string(text.substr(0, end)),
          .part = std::string(text.substr(std::min(end + 1, text.size())))};
}

std::int64_t NetcdfCodeOf(absl::string_view letters) {
  std::int64_t code = 0;
  for (const char letter : letters) {
    code = code * 6 + static_cast<std::int64_t>(kNetcdfLetters.find(letter));
  }
  return letters.empty() ? 0 : code + 1;
}

std::string NetcdfLettersOf(std::int64_t code, std::size_t rank) {
  std::string letters(code == 0 ? 0 : rank, '-');
  std::int64_t digits = code - 1;
  for (std::size_t i = letters.size(); i-- > 0; digits /= 6) {
    letters[i] = kNetcdfLetters[static_cast<std::size_t>(digits % 6)];
  }
  return letters;
}

// ---- The volumes. -------------------------------------------------------------------------------

absl::StatusOr<CfRoles> NetcdfRolesOf(const NetcdfVariable& array, const std::string& letters) {
  if (!letters.empty()) {
    return CfRolesFrom(letters, array.axes);
  }
  const std::optional<CfRoles> roles = CfRolesOf(array.axes);
  return roles.has_value() ? absl::StatusOr<CfRoles>(*roles) : absl::NotFoundError("");
}

// Tells why an array is no volume, with a command that gives the meaning of its axes.
absl::Status NoNetcdfVolume(const NetcdfVariable& array, const std::string& path) {
  const std::string letters = SuggestCfAxes(array.axes);
  PartPath parts;
  return absl::InvalidArgumentError(absl::StrCat(
      path, ":", base::Printable(array.name), ": its axes are ", DescribeCfAxes(array.axes),
      ", by CF's attributes (axis, units, standard_name, positive) or their names; expected one Z, "
      "one Y and one X of 2 samples or more",
      letters.empty() ? ""
                      : absl::StrCat(": if the file does not say it, you can, slowest first (T "
                                     "time, C components, - an axis of 1 element), as in "
                                     "`isoscope partition ",
                                     base::ShellWord(SplitPartPath(path, NetcdfEndings(), &parts)
                                                         ? absl::StrCat(path, ":", array.name)
                                                         : path),
                                     " --axes ", letters, " --output DIR`")));
}

struct NetcdfVolumes {
  std::vector<NetcdfVariable> volumes;
  std::vector<std::int64_t> numbers;
};

// The volumes of a file, with their roles. INVALID_ARGUMENT: none; the part names an array that is
// none.
absl::StatusOr<NetcdfVolumes> FindNetcdfVolumes(NetcdfFile* file, const NetcdfRequest& request) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<NetcdfVariable> arrays, file->Arrays());
  const std::string& path = file->path();
  NetcdfVolumes found;
  const NetcdfVariable* example = nullptr;  // that advice can be given for
  for (std::size_t i = 0; i < arrays.size(); ++i) {
    const NetcdfVariable& array = arrays[i];
    const auto roles = NetcdfRolesOf(array, request.letters);
    if (!roles.ok() && IsNetcdfNamed(array, request.part)) {
      return request.letters.empty()
                 ? NoNetcdfVolume(array, path)
                 : absl::InvalidArgumentError(absl::StrCat(path, ":", base::Printable(array.name),
                                                           ": ", roles.status().message()));
    }
    if (!roles.ok()) {
      const bool is_better = example == nullptr || (SuggestCfAxes(example->axes).empty() &&
                                                    !SuggestCfAxes(array.axes).empty());
      example = is_better ? &array : example;
      continue;
    }
    found.volumes.push_back(array);
    found.volumes.back().roles = *roles;
    found.numbers.push_back(static_cast<std::int64_t>(i) * kNetcdfCodes +
                            NetcdfCodeOf(request.letters));
  }
  if (!found.volumes.empty()) {
    return found;
  }
  if (example == nullptr) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": no variable of numbers has three axes or more"));
  }
  return request.letters.empty()
             ? NoNetcdfVolume(*example, path)
             : absl::InvalidArgumentError(absl::StrFormat(
                   "%s: --axes %s: no variable has such axes; \"%s\" has %s", path, request.letters,
                   base::Printable(example->name), DescribeCfAxes(example->axes)));
}

// Components of an ensemble are numbers, those of vectors have their names.
std::vector<std::string> NetcdfComponents(const NetcdfVariable& volume, std::int64_t count) {
  std::vector<std::string> names = ComponentNames(count);
  const bool is_vector = !volume.roles.component.has_value() ||
                         AxisLetterOf(volume.axes[*volume.roles.component].name) == 'C';
  for (std::int64_t i = 0; !is_vector && count > 1 && i < count; ++i) {
    names[static_cast<std::size_t>(i)] = absl::StrCat(i);
  }
  return names;
}

absl::Status DescribeNetcdfTimes(const NetcdfVariable& chosen, const std::string& path,
                                 WalledFile* described) {
  const CfAxis& time = chosen.axes[*chosen.roles.time];
  if (time.size < 1 || time.size > kMaxNetcdfSteps) {
    return absl::InvalidArgumentError(absl::StrFormat("%s: %d steps of time; expected 1 to %d",
                                                      path, time.size, kMaxNetcdfSteps));
  }
  auto times = CfTimesOf(time);
  if (!times.ok()) {
    return absl::Status(times.status().code(), absl::StrCat(path, ": ", times.status().message()));
  }
  described->info.times = *std::move(times);
  described->info.time_unit = time.units;
  return absl::OkStatus();
}

absl::StatusOr<std::vector<std::string>> DescribeNetcdf(const std::string& path,
                                                        const std::string& part) {
  const NetcdfRequest request = ParseNetcdfRequest(part);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<NetcdfFile> file, NetcdfFile::Open(path));
  ISOSCOPE_ASSIGN_OR_RETURN(const NetcdfVolumes found, FindNetcdfVolumes(file.get(), request));
  const NetcdfVariable& chosen = ChooseGrid(found.volumes, request.part);
  WalledFile described{.info = {.length_unit = CfLengthUnit(chosen.axes, chosen.roles)}};
  if (chosen.roles.time.has_value()) {
    ISOSCOPE_RETURN_IF_ERROR(DescribeNetcdfTimes(chosen, path, &described));
  }
  if (const auto grid = CfUnevenGridOf(chosen.axes, chosen.roles, {.has_spacing = true});
      grid.ok()) {
    described.distances = grid->distances;  // else whoever opens a volume gets the error
  }
  for (std::size_t i = 0; i < found.volumes.size(); ++i) {
    const NetcdfVariable& volume = found.volumes[i];
    const std::int64_t components =
        volume.roles.component.has_value() ? volume.axes[*volume.roles.component].size : 1;
    if (AreOnOneGrid(chosen, volume) && components >= 1 && components <= kMaxNetcdfComponents) {
      described.Add({.name = volume.name,
                     .long_name = file->Text(volume, {"long_name", "standard_name"}),
                     .unit = file->Text(volume, {"units"}),
                     .components = NetcdfComponents(volume, components)},
                    found.numbers[i]);
    } else if (!AreOnOneGrid(chosen, volume)) {
      described.info.fields_elsewhere.push_back(volume.name);
    }
  }
  return WalledTexts(described);
}

template <bool takes_uneven>
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenNetcdfPart(const std::string& path,
                                                             const std::string& part) {
  const auto [number, step, component] = ParseWalledPart(part);
  const auto place = static_cast<std::size_t>(number / kNetcdfCodes);
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<NetcdfFile> file, NetcdfFile::Open(path));
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<NetcdfVariable> arrays, file->Arrays());
  if (place < arrays.size()) {
    NetcdfVariable& wanted = arrays[place];
    const auto roles =
        NetcdfRolesOf(wanted, NetcdfLettersOf(number % kNetcdfCodes, wanted.axes.size()));
    wanted.roles = roles.value_or(CfRoles());
    const CfRoles& known = wanted.roles;
    if (roles.ok() && step < (known.time.has_value() ? wanted.axes[*known.time].size : 1) &&
        component < (known.component.has_value() ? wanted.axes[*known.component].size : 1)) {
      GridRules rules = GivenRules(part);
      rules.resamples = takes_uneven;
      return OpenNetcdfVolume(std::move(file), wanted, step, component, rules);
    }
  }
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: no array %d with step %d and component %d: it has changed", path, place,
                      step, component));
}

constexpr WalledLibrary kNetcdf = {.name = "netCDF",
                                   .open = OpenNetcdfPart<false>,
                                   .find_files = nullptr,
                                   .describe = DescribeNetcdf};
constexpr WalledLibrary kUnevenNetcdf = {.name = "netCDF",
                                         .open = OpenNetcdfPart<true>,
                                         .find_files = nullptr,
                                         .describe = DescribeNetcdf};

}  // namespace

bool IsNetcdf(absl::string_view head) {
  constexpr absl::string_view kHdf5("\x89HDF\r\n\x1a\n", 8);
  return absl::StartsWith(head, kHdf5) || (absl::StartsWith(head, "CDF") && head.size() > 3 &&
                                           (head[3] == 1 || head[3] == 2 || head[3] == 5));
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenNetcdfSeries(const std::string& file,
                                                               const std::string& part,
                                                               const GridRules& rules,
                                                               const std::string& axes) {
  if (axes.size() > kMaxNetcdfLetters ||
      axes.find_first_not_of(std::string(kNetcdfLetters)) != std::string::npos) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: --axes %s: expected at most %d of the letters T, C, Z, Y, X and -",
                        file, axes, kMaxNetcdfLetters));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSeries> series,
                            OpenWalledSeries(rules.resamples ? kUnevenNetcdf : kNetcdf, file,
                                             NetcdfRequestText(axes, part), rules));
  if (series == nullptr) {
    return absl::InvalidArgumentError(absl::StrCat(file, ": no volume in it"));
  }
  return series;
}

}  // namespace isoscope::source
