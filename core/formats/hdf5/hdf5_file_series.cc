// The names of files are those of openPMD's attribute iterationFormat, as in "data%08T.h5".
//
// Source: openPMD standard 1.1, https://github.com/openPMD/openPMD-standard, "Iterations and Time
// Series".

#include "core/formats/hdf5/hdf5_file_series.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"

#include "core/base/shell_word.h"
#include "core/base/status_macros.h"
#include "core/formats/hdf5/hdf5_links.h"
#include "core/formats/hdf5/hdf5_mesh.h"
#include "core/formats/hdf5/hdf5_mesh_series.h"
#include "core/io/file.h"
#include "core/source/bytes/named_files.h"
#include "core/source/child/walled_source.h"
#include "core/source/grid/one_grid.h"
#include "core/source/hdf5/hdf5_file.h"
#include "core/source/hdf5/hdf5_handle.h"
#include "core/source/series_parts.h"
#include "core/volume/grid_geometry.h"
#include "hdf5.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kMaxHdf5Files = 100'000;

bool IsHdf5FileOfPattern(const std::string& path) {
  Hdf5Path parts;
  return SplitHdf5Path(path, &parts) && parts.dataset.empty();
}

// In the child. "netCDF" of a file that netCDF-4 wrote: it names itself, or numbers its dimensions
// (before version 4.4.1).
absl::StatusOr<std::vector<std::string>> DescribeWriter(const std::string& path,
                                                        const std::string& /*part*/) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Hdf5Handle file, OpenHdf5File(path));
  bool is_netcdf = H5Aexists(file.get(), "_NCProperties") > 0;
  for (const std::string& name : is_netcdf ? std::vector<std::string>() : Hdf5NamesIn(file.get())) {
    const Hdf5Handle object(H5Oopen(file.get(), name.c_str(), H5P_DEFAULT), H5Oclose);
    is_netcdf = is_netcdf || H5Aexists(object.get(), "_Netcdf4Dimid") > 0;
  }
  return is_netcdf ? std::vector<std::string>{"netCDF"} : std::vector<std::string>();
}

constexpr WalledLibrary kHdf5Writer = {
    .name = "HDF5", .open = nullptr, .find_files = nullptr, .describe = DescribeWriter};

bool IsDigit(char c) { return absl::ascii_isdigit(static_cast<unsigned char>(c)); }

// "run/data", "%06T" as 6 digits, ".h5".
struct IterationPattern {
  std::string before;
  std::string behind;
  std::size_t digits = 0;  // at least
};

std::optional<IterationPattern> ParseIterationPattern(const std::string& file) {
  for (std::size_t mark = file.find('%'); mark != std::string::npos;
       mark = file.find('%', mark + 1)) {
    std::size_t end = mark + 1;
    while (end < file.size() && IsDigit(file[end])) {
      ++end;
    }
    const std::string width = file.substr(mark + 1, end - mark - 1);
    std::size_t digits = 1;
    if (end == file.size() || file[end] != 'T' ||
        (!width.empty() && (width[0] != '0' || !absl::SimpleAtoi(width, &digits)))) {
      continue;
    }
    return IterationPattern{.before = file.substr(0, mark),
                            .behind = file.substr(end + 1),
                            .digits = std::max<std::size_t>(digits, 1)};
  }
  return std::nullopt;
}

// Returns a pattern for FilesNamed in which each character stands for itself.
std::string LiteralPattern(absl::string_view text) {
  std::string escaped;
  for (const char c : text) {
    if (absl::StrContains("*?[\\", c)) {
      escaped += '\\';
    }
    escaped += c;
  }
  return escaped;
}

bool IsIteration(const IterationPattern& pattern, const std::string& file) {
  const std::size_t ends = pattern.before.size() + pattern.behind.size();
  if (file.size() < ends + pattern.digits || !absl::StartsWith(file, pattern.before) ||
      !absl::EndsWith(file, pattern.behind)) {
    return false;
  }
  const std::string number = file.substr(pattern.before.size(), file.size() - ends);
  const bool is_padded = pattern.digits > 1 && number.size() > pattern.digits && number[0] == '0';
  return std::all_of(number.begin(), number.end(), IsDigit) && !is_padded;
}

const SourceField* FindField(const VolumeSeries& series, const std::string& name) {
  const std::vector<SourceField>& fields = series.info().fields;
  const auto found = std::find_if(fields.begin(), fields.end(),
                                  [&](const SourceField& field) { return field.name == name; });
  return found == fields.end() ? nullptr : &*found;
}

class Hdf5FileSeries final : public VolumeSeries {
 public:
  // The first file must be there.
  Hdf5FileSeries(SeriesInfo info, std::vector<std::unique_ptr<VolumeSeries>> steps,
                 const volume::GridGeometry& grid)
      : VolumeSeries(std::move(info)), steps_(std::move(steps)), grid_(grid) {}

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    VolumeSeries& file = *steps_[static_cast<std::size_t>(step)];
    const auto number = FindField(file, info().field(field).name) - file.info().fields.data();
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> volume,
                              file.Open(static_cast<int>(number), component, 0));
    ISOSCOPE_RETURN_IF_ERROR(CheckOneGrid(absl::StrFormat("%s: step %d", volume->info().name, step),
                                          volume->info().geometry, steps_.front()->info().name,
                                          grid_));
    return volume;
  }
  // Returns the file of the step and the files that it links to.
  absl::StatusOr<std::optional<std::vector<std::string>>> FilesOfStep(int step) override {
    ISOSCOPE_ASSIGN_OR_RETURN(
        std::vector<std::string> files,
        FilesOfHdf5Trees({steps_[static_cast<std::size_t>(step)]->info().name}));
    return files;
  }

 private:
  const std::vector<std::unique_ptr<VolumeSeries>> steps_;  // by step; have all fields
  const volume::GridGeometry grid_;
};

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenStep(const std::string& file,
                                                       const std::string& part,
                                                       const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSeries> series,
                            OpenHdf5MeshSeries(file, part, rules));
  if (series == nullptr) {
    return absl::InvalidArgumentError(absl::StrCat(
        file, ": it does not describe its meshes; a pattern of HDF5 files is for those that do"));
  }
  if (series->info().step_count() != 1) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d steps; a pattern of HDF5 files is for those of one step: name "
                        "this file alone",
                        file, series->info().step_count()));
  }
  return series;
}

// All that the first has.
absl::Status CheckFields(const VolumeSeries& series, const SeriesInfo& first) {
  const SeriesInfo& step = series.info();
  if (step.length_unit != first.length_unit || step.time_unit != first.time_unit) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: units \"%s\" of length and \"%s\" of time; the first step, %s, has \"%s\" and \"%s\"",
        step.name, step.length_unit, step.time_unit, first.name, first.length_unit,
        first.time_unit));
  }
  for (const SourceField& wanted : first.fields) {
    const SourceField* const field = FindField(series, wanted.name);
    if (field == nullptr) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: no field \"%s\" on its grid, but %s; the first step, %s, has one",
                          step.name, wanted.name, DescribeFields(step.fields), first.name));
    }
    if (field->components != wanted.components || field->unit != wanted.unit) {
      return absl::InvalidArgumentError(absl::StrFormat("%s: %s; the first step, %s, has %s",
                                                        step.name, DescribeFields({*field}),
                                                        first.name, DescribeFields({wanted})));
    }
  }
  return absl::OkStatus();
}

// Numbers if no file has a time.
absl::StatusOr<std::vector<double>> TimesOf(
    const std::vector<std::unique_ptr<VolumeSeries>>& steps) {
  std::vector<double> times;
  const SeriesInfo& first = steps.front()->info();
  for (const std::unique_ptr<VolumeSeries>& series : steps) {
    const SeriesInfo& step = series->info();
    if (step.times.empty() != first.times.empty()) {
      const bool has_time = !step.times.empty();
      return absl::InvalidArgumentError(
          absl::StrFormat("%s has %s time, but the first step, %s, has %s", step.name,
                          has_time ? "a" : "no", first.name, has_time ? "none" : "one"));
    }
    const double time = step.times.empty() ? static_cast<double>(times.size()) : step.times.front();
    if (!times.empty() && !(time > times.back())) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s has the time %g, behind %g of %s; expected times that ascend with "
                          "the numbers in names, each once",
                          step.name, time, times.back(), steps[times.size() - 1]->info().name));
    }
    times.push_back(time);
  }
  return steps.size() == 1 ? first.times : times;
}

}  // namespace

absl::StatusOr<std::optional<std::vector<std::string>>> FilesOfHdf5Pattern(
    const std::string& file) {
  if (io::PathExists(file)) {
    return std::nullopt;
  }
  std::vector<std::string> files;
  if (const auto pattern = ParseIterationPattern(file); pattern.has_value()) {
    files = FilesNamed(
        absl::StrCat(LiteralPattern(pattern->before), "*", LiteralPattern(pattern->behind)),
        IsHdf5FileOfPattern);
    files.erase(
        std::remove_if(files.begin(), files.end(),
                       [&](const std::string& found) { return !IsIteration(*pattern, found); }),
        files.end());
  } else if (file.find_first_of("*?[") != std::string::npos) {
    files = FilesNamed(file, IsHdf5FileOfPattern);
  } else {
    return std::nullopt;
  }
  if (files.empty()) {
    return absl::NotFoundError(absl::StrCat(file, ": no HDF5 file has such a name"));
  }
  return files;
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenHdf5FileSeries(
    const std::string& name, const std::vector<std::string>& files, const std::string& part,
    const GridRules& rules) {
  if (files.size() > kMaxHdf5Files) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d files; expected at most %d", name, files.size(), kMaxHdf5Files));
  }
  std::vector<std::unique_ptr<VolumeSeries>> steps;
  volume::GridGeometry grid;
  for (const std::string& file : files) {
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSeries> step, OpenStep(file, part, rules));
    if (!steps.empty()) {
      ISOSCOPE_RETURN_IF_ERROR(CheckFields(*step, steps.front()->info()));
    }
    // One volume tells the grid, because those of a file lie on one.
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<VolumeSource> volume, step->Open(0, 0, 0));
    if (steps.empty()) {
      grid = volume->info().geometry;
    }
    ISOSCOPE_RETURN_IF_ERROR(CheckOneGrid(file, volume->info().geometry, files.front(), grid));
    steps.push_back(std::move(step));
  }
  SeriesInfo info = steps.front()->info();
  info.name = name;
  info.fields_elsewhere.clear();
  ISOSCOPE_ASSIGN_OR_RETURN(info.times, TimesOf(steps));
  return std::make_unique<Hdf5FileSeries>(std::move(info), std::move(steps), grid);
}

absl::StatusOr<bool> IsWrittenByNetcdf(const std::string& file) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> writer,
                            DescribeWalled(kHdf5Writer, file, ""));
  return !writer.empty();
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenHdf5Meshes(const Hdf5Path& path,
                                                             const GridRules& rules) {
  const bool names_dataset = absl::StartsWith(path.dataset, "/");
  ISOSCOPE_ASSIGN_OR_RETURN(const auto files, FilesOfHdf5Pattern(path.file));
  if (files.has_value() && names_dataset) {
    return absl::InvalidArgumentError(
        absl::StrCat(path.name(), ": a dataset of a pattern; expected a mesh, as in ",
                     base::ShellWord(absl::StrCat(path.file, ":E")), ", or one file"));
  }
  if (files.has_value()) {
    return OpenHdf5FileSeries(path.file, *files, path.dataset, rules);
  }
  if (names_dataset) {
    return nullptr;
  }
  return OpenHdf5MeshSeries(path.file, path.dataset, rules);
}

}  // namespace isoscope::source
