#include "client-cli/session/series_flags.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

#include "clients/cpp/request/parse_value.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"
#include "core/source/hdf5_source.h"
#include "core/source/series_format.h"
#include "core/source/vtk_image.h"
#include "core/store/series_manifest.h"

namespace isoscope::cli {
namespace {

// A raw file: one field, whose name is that of the file, and one step.
class RawSeries final : public source::VolumeSeries {
 public:
  RawSeries(const SourceFlags& flags, std::string path) : flags_(flags), path_(std::move(path)) {
    std::string name = path_.substr(path_.rfind('/') + 1);
    if (const std::size_t dot = name.rfind('.'); dot != std::string::npos && dot > 0) {
      name.resize(dot);
    }
    fields_.push_back({.name = std::move(name), .long_name = "", .unit = ""});
  }
  [[nodiscard]] const std::string& name() const override { return path_; }
  [[nodiscard]] const std::vector<source::SourceField>& fields() const override { return fields_; }
  [[nodiscard]] const std::vector<double>& times() const override { return times_; }
  [[nodiscard]] const std::string& time_unit() const override { return unit_; }
  [[nodiscard]] const std::string& length_unit() const override { return unit_; }
  absl::StatusOr<std::unique_ptr<source::VolumeSource>> Open(int /*field*/, int /*component*/,
                                                             int /*step*/) override {
    return OpenSource(flags_, path_);
  }

 private:
  const SourceFlags flags_;
  const std::string path_;
  std::vector<source::SourceField> fields_;
  const std::vector<double> times_;
  const std::string unit_;
};

// Whether the format has names for fields.
bool HasFieldNames(const std::string& path) {
  source::Hdf5Path hdf5;
  source::PartPath vti;
  const std::string file = path.substr(0, path.find(':'));
  const std::optional<source::SeriesFile> known = source::FindSeriesFileByName(path);
  return (known.has_value() && known->format->has_field_names) ||
         source::SplitHdf5Path(path, &hdf5) || source::SplitVtkImagePath(path, &vti) ||
         absl::EndsWithIgnoreCase(file, ".pvd") || absl::EndsWithIgnoreCase(file, ".h5") ||
         absl::EndsWithIgnoreCase(file, ".hdf5");
}

// Letters, each once, or -, those of TIFF's pages with counts; the reader checks what its file can
// have.
absl::StatusOr<std::string> ParseAxes(absl::string_view text) {
  std::string letters;
  bool is_good = !text.empty();
  for (const char c : text) {
    const bool is_digit = absl::ascii_isdigit(static_cast<unsigned char>(c));
    is_good =
        is_good &&
        (is_digit ? !letters.empty()
                  : c == '-' || (absl::string_view("TCZYX").find(c) != absl::string_view::npos &&
                                 letters.find(c) == std::string::npos));
    if (!is_digit) {
      letters += c;
    }
  }
  if (!is_good) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", text,
                     "' is no list of axes, slowest first, such as ZYX, TZYX or TCZYX, or TC3Z20 "
                     "for the pages of a TIFF stack"));
  }
  return std::string(text);
}

}  // namespace

absl::StatusOr<partition::StepRange> ParseStepRange(absl::string_view text) {
  const std::vector<std::string> parts = absl::StrSplit(text, ':');
  std::vector<int> numbers;
  for (const std::string& part : parts) {
    const absl::StatusOr<std::int64_t> number = client::ParseInteger(part, 0, store::kMaxSteps - 1);
    if (number.ok()) {
      numbers.push_back(static_cast<int>(*number));
    }
  }
  if (numbers.size() != parts.size() || numbers.size() > 3 ||
      (numbers.size() > 1 && numbers[0] > numbers[1]) || (numbers.size() > 2 && numbers[2] < 1)) {
    return absl::InvalidArgumentError(absl::StrCat(
        "'", text, "' is neither a step N nor a range A:B or A:B:S of steps, the first one 0"));
  }
  return partition::StepRange{.first = numbers[0],
                              .last = numbers.size() > 1 ? numbers[1] : numbers[0],
                              .stride = numbers.size() > 2 ? numbers[2] : 1};
}

void AddSeriesFlags(FlagSet* set, SeriesFlags* flags) {
  const auto add = [](Flag flag) { flag.Group("Fields and time steps"); };
  add(AddRepeatableFlag(set, "--field", "NAME", &flags->fields, ParseText,
                        "a field of the source, or the name of the only one of a format without "
                        "names; may be repeated (default: all)"));
  add(AddFlag(set, "--step", "N|A:B[:S]", &flags->steps, ParseStepRange,
              "steps of the source: A, A + S, ..., up to and with B (default: all)"));
  add(AddFlag(set, "--time", "VALUE", &flags->time, client::ParseNumber,
              "the time of a source that has none"));
  add(AddFlag(set, "--axes", "AXES", &flags->axes, ParseAxes,
              "the axes of an HDF5 dataset or a netCDF variable, slowest first, of the letters T "
              "(time), C (component), Z, Y, X, and - for one of 1 element; for the pages of a TIFF "
              "stack T, C and Z with counts, as TC3Z20 (default: as the file says)"));
}

absl::StatusOr<std::unique_ptr<source::VolumeSeries>> OpenSourceSeries(const SourceFlags& source,
                                                                       const SeriesFlags& series,
                                                                       const std::string& path) {
  std::unique_ptr<source::VolumeSeries> opened;
  if (source.dims) {
    if (series.axes) {
      return UsageError(
          "--axes is for HDF5, netCDF and TIFF files; the samples of a raw file lie as ZYX");
    }
    opened = std::make_unique<RawSeries>(source, path);
  } else {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string file, PathOfSource(source, path));
    ISOSCOPE_ASSIGN_OR_RETURN(opened,
                              source::OpenVolumeSeries(file, {.axes = series.axes.value_or(""),
                                                              .format = source.format.value_or(""),
                                                              .rules = source.rules()}));
    opened = source::AdjustSeries(std::move(opened), source.adjustment());
  }
  return partition::SelectFrom(std::move(opened), {.fields = series.fields,
                                                   .names_field = !HasFieldNames(path),
                                                   .steps = series.steps,
                                                   .time = series.time});
}

}  // namespace isoscope::cli
