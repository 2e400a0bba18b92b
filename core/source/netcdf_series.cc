#include "core/source/netcdf_series.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/source/located_series.h"
#include "core/source/netcdf_file.h"
#include "core/source/netcdf_source.h"
#include "core/source/walled_series.h"
#include "core/source/walled_source.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxNetcdfSteps = 100'000;
constexpr std::int64_t kMaxNetcdfComponents = 4096;

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
  WalledFile described{.length_unit = CfLengthUnit(chosen.axes, chosen.roles)};
  if (chosen.roles.time.has_value()) {
    const CfAxis& time = chosen.axes[*chosen.roles.time];
    if (time.size < 1 || time.size > kMaxNetcdfSteps) {
      return absl::InvalidArgumentError(absl::StrFormat("%s: %d steps of time; expected 1 to %d",
                                                        path, time.size, kMaxNetcdfSteps));
    }
    auto times = CfTimesOf(time);
    if (!times.ok()) {
      return absl::Status(times.status().code(),
                          absl::StrCat(path, ": ", times.status().message()));
    }
    described.times = *std::move(times);
    described.time_unit = time.units;
  }
  if (const auto grid = CfUnevenGridOf(chosen.axes, chosen.roles); grid.ok()) {
    described.distances = grid->distances;  // else whoever opens a volume gets the error
  }
  for (std::size_t i = 0; i < volumes.size(); ++i) {
    const NetcdfVariable& volume = volumes[i];
    const std::int64_t components =
        volume.roles.component.has_value() ? volume.axes[*volume.roles.component].size : 1;
    if (AreOnOneGrid(chosen, volume) && components >= 1 && components <= kMaxNetcdfComponents) {
      described.fields.push_back(
          {.field = {.name = volume.name,
                     .long_name = file->Text(volume, {"long_name", "standard_name"}),
                     .unit = file->Text(volume, {"units"}),
                     .components = ComponentNames(components)},
           .number = static_cast<std::int64_t>(i)});
    }
  }
  return WalledTexts(described);
}

template <bool takes_uneven>
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenNetcdfPart(const std::string& path,
                                                             const std::string& part) {
  const auto [variable, step, component] = ParseWalledPart(part);
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<NetcdfFile> file, NetcdfFile::Open(path));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<NetcdfVariable> volumes, file->Volumes());
  if (variable < static_cast<std::int64_t>(volumes.size())) {
    const NetcdfVariable& wanted = volumes[static_cast<std::size_t>(variable)];
    const CfRoles& roles = wanted.roles;
    if (step < (roles.time.has_value() ? wanted.axes[*roles.time].size : 1) &&
        component < (roles.component.has_value() ? wanted.axes[*roles.component].size : 1)) {
      return OpenNetcdfVolume(std::move(file), wanted, step, component, takes_uneven);
    }
  }
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: no variable %d with step %d and component %d: it has changed", path,
                      variable, step, component));
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
                                                               const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(
      std::unique_ptr<VolumeSeries> series,
      OpenWalledSeries(rules.resamples ? kUnevenNetcdf : kNetcdf, file, part, rules));
  if (series == nullptr) {
    return absl::InvalidArgumentError(absl::StrCat(file, ": no volume in it"));
  }
  return series;
}

}  // namespace isoscope::source
