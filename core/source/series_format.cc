#include "core/source/series_format.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/source/cube_series.h"
#include "core/source/file_layout.h"
#include "core/source/file_start.h"
#include "core/source/hdf5_links.h"
#include "core/source/itk_image.h"
#include "core/source/layout_formats.h"
#include "core/source/legacy_vtk_parser.h"
#include "core/source/legacy_vtk_series.h"
#include "core/source/minc_source.h"
#include "core/source/mrc_series.h"
#include "core/source/netcdf_series.h"
#include "core/source/part_path.h"
#include "core/source/slc_series.h"
#include "core/source/tiff_file.h"
#include "core/source/tiff_source.h"
#include "core/source/vdb_series.h"
#include "core/source/vtk_series.h"
#include "core/volume/field_name.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kHeadBytes = 1024;

// One field of a series, or one component of it.
class PartSeries final : public VolumeSeries {
 public:
  PartSeries(std::unique_ptr<VolumeSeries> whole, int field, std::optional<int> component)
      : whole_(std::move(whole)),
        fields_{whole_->fields()[static_cast<std::size_t>(field)]},
        field_(field),
        component_(component) {
    if (component.has_value()) {
      fields_[0].components = {""};
    }
  }

  [[nodiscard]] const std::string& name() const override { return whole_->name(); }
  [[nodiscard]] const std::vector<SourceField>& fields() const override { return fields_; }
  [[nodiscard]] const std::vector<double>& times() const override { return whole_->times(); }
  [[nodiscard]] const std::string& time_unit() const override { return whole_->time_unit(); }
  [[nodiscard]] const std::string& length_unit() const override { return whole_->length_unit(); }

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int /*field*/, int component,
                                                     int step) override {
    return whole_->Open(field_, component_.value_or(component), step);
  }
  absl::StatusOr<std::optional<std::vector<std::string>>> FilesOfStep(int step) override {
    return whole_->FilesOfStep(step);
  }

 private:
  const std::unique_ptr<VolumeSeries> whole_;
  std::vector<SourceField> fields_;
  const int field_;
  const std::optional<int> component_;
};

// -1 if there is none.
int FieldNumber(const std::vector<SourceField>& fields, absl::string_view name) {
  const auto found = std::find_if(fields.begin(), fields.end(),
                                  [&](const SourceField& field) { return field.name == name; });
  return found == fields.end() ? -1 : static_cast<int>(found - fields.begin());
}

int ComponentNumber(const std::vector<std::string>& components, absl::string_view name) {
  const auto found = std::find(components.begin(), components.end(), name);
  int number = -1;
  if (found != components.end()) {
    return static_cast<int>(found - components.begin());
  }
  return absl::SimpleAtoi(name, &number) && number < static_cast<int>(components.size()) ? number
                                                                                         : -1;
}

// A format whose header file says all.
template <bool (*is_content)(absl::string_view),
          absl::StatusOr<FileLayout> (*read)(const std::string&)>
SeriesFormat LayoutRow(absl::string_view name, std::vector<std::string> endings) {
  return {.name = name,
          .endings = std::move(endings),
          .is_content = is_content,
          .open_by_rules =
              [](const std::string& file, const std::string& field, const std::string& /*part*/,
                 const GridRules& rules) -> absl::StatusOr<std::unique_ptr<VolumeSeries>> {
            ISOSCOPE_ASSIGN_OR_RETURN(FileLayout layout, read(LayoutHeaderPath(file)));
            return MakeLayoutSeries(file, field, std::move(layout), rules);
          },
          .find_files = [](const std::string& file) -> absl::StatusOr<std::vector<std::string>> {
            std::vector<std::string> files = {LayoutHeaderPath(file)};
            ISOSCOPE_ASSIGN_OR_RETURN(const FileLayout layout, read(files.front()));
            const std::vector<std::string>& others = layout.location.files;
            if (others.front() != files.front()) {
              files.insert(files.end(), others.begin(), others.end());
            }
            return files;
          }};
}

// The header, and its samples: in the file that it names, else beside it. ITK decides, so all that
// are there count.
absl::StatusOr<std::vector<std::string>> FilesOfStimulate(const std::string& file) {
  constexpr std::int64_t kMaxHeaderBytes = 64 * base::kKiB;
  constexpr absl::string_view kNameKey = "stimFileName:";
  std::vector<std::string> files = {file};
  std::vector<std::string> candidates = {file.substr(0, file.size() - 3) + "sdt"};
  const absl::StatusOr<std::string> header = io::ReadWholeFile(file, kMaxHeaderBytes);
  for (const absl::string_view line : absl::StrSplit(header.value_or(""), '\n')) {
    absl::string_view name = absl::StripAsciiWhitespace(line);
    if (absl::ConsumePrefix(&name, kNameKey)) {
      name = absl::StripAsciiWhitespace(name);
      candidates.emplace_back(name);
      candidates.push_back(absl::StrCat(file.substr(0, file.rfind('/') + 1), name));
    }
  }
  for (std::string& candidate : candidates) {
    if (io::PathExists(candidate) && !io::IsDirectory(candidate) &&
        std::find(files.begin(), files.end(), candidate) == files.end()) {
      files.push_back(std::move(candidate));
    }
  }
  return files;
}

// netCDF-4 and MINC 2 are HDF5 files, which may link to others.
absl::StatusOr<std::vector<std::string>> FilesOfNetcdf(const std::string& file) {
  const absl::StatusOr<FileStart> start = ReadFileStart(file, 4);
  if (start.ok() && absl::StartsWith(start->bytes, "CDF")) {
    return std::vector<std::string>{file};
  }
  return FilesOfHdf5Trees({file});
}

}  // namespace

const std::vector<SeriesFormat>& SeriesFormats() {
  static const auto* const formats = new std::vector<SeriesFormat>{
      {.name = "MRC",
       .endings = {".mrc", ".mrcs", ".map", ".ccp4", ".mrc.gz", ".map.gz", ".ccp4.gz"},
       .is_content = IsMrcHeader,
       .open_by_rules = [](const std::string& file, const std::string& field,
                           const std::string& /*part*/,
                           const GridRules& rules) { return OpenMrcSeries(file, field, rules); }},
      {.name = "MINC",
       .endings = {".mnc"},
       .open = [](const std::string& file, const std::string& field,
                  const std::string& /*part*/) { return OpenMincSeries(file, field); },
       .find_files = FilesOfNetcdf},
      // These three share their endings; ITK reads NIfTI-1 where the name has one of them.
      LayoutRow<IsNifti1Header, ReadNiftiHeaderLayout>(kNifti1Name, {}),
      LayoutRow<IsNifti2Header, ReadNiftiHeaderLayout>("NIfTI-2", {}),
      LayoutRow<IsAnalyzeHeader, ReadAnalyzeLayout>("Analyze", {}),
      LayoutRow<IsMghHeader, ReadMghLayout>("MGH", {".mgh", ".mgz", ".mgh.gz"}),
      LayoutRow<IsAfniHeader, ReadAfniLayout>("AFNI", {".head", ".brik", ".brik.gz", ".brik.bz2"}),
      LayoutRow<IsParHeader, ReadParRecLayout>("PAR/REC", {".par"}),
      LayoutRow<IsGiplHeader, ReadGiplLayout>("GIPL", {".gipl", ".gipl.gz"}),
      LayoutRow<IsBrukerHeader, ReadBrukerLayout>("ParaVision", {"2dseq", "visu_pars"}),
      {.name = "legacy VTK",
       .endings = {".vtk"},
       .has_field_names = true,
       .is_content = IsLegacyVtk,
       .open_by_rules =
           [](const std::string& file, const std::string& field, const std::string& /*part*/,
              const GridRules& rules) { return OpenLegacyVtkSeries(file, field, rules); }},
      {.name = "rectilinear VTK",
       .endings = {".vtr"},
       .has_field_names = true,
       .open_by_rules = [](const std::string& file, const std::string& /*field*/,
                           const std::string& /*part*/,
                           const GridRules& rules) { return OpenVtrSeries(file, rules); }},
      {.name = "Gaussian cube",
       .endings = {".cube", ".cub"},
       .open = [](const std::string& file, const std::string& field,
                  const std::string& /*part*/) { return OpenCubeSeries(file, field); }},
      {.name = "TIFF",
       .endings = {".tif", ".tiff", ".lsm"},
       .more_names = ", a folder of them, or a pattern",
       .is_content = IsTiff,
       .open_as =
           [](const std::string& file, const std::string& field, const std::string& /*part*/,
              const GridRules& rules,
              const std::string& axes) { return OpenTiffSeries({file}, file, field, axes, rules); },
       .open_by_rules =
           [](const std::string& file, const std::string& field, const std::string& /*part*/,
              const GridRules& rules) { return OpenTiffSeries({file}, file, field, "", rules); },
       .find_files = FilesOfTiff},
      {.name = "BioRad",
       .endings = {".pic"},
       .open = [](const std::string& file, const std::string& field,
                  const std::string& /*part*/) { return OpenItkImage(file, field); }},
      {.name = "Stimulate",
       .endings = {".spr"},
       .open = [](const std::string& file, const std::string& field,
                  const std::string& /*part*/) { return OpenItkImage(file, field); },
       .find_files = FilesOfStimulate},
      {.name = "SLC",
       .endings = {".slc"},
       .is_content = IsSlc,
       .open = [](const std::string& file, const std::string& field,
                  const std::string& /*part*/) { return OpenSlcSeries(file, field); }},
      {.name = "OpenVDB",
       .endings = {".vdb"},
       .has_field_names = true,
       .is_content = IsVdb,
       .open_by_rules = [](const std::string& file, const std::string& /*field*/,
                           const std::string& part,
                           const GridRules& rules) { return OpenVdbSeries(file, part, rules); }},
      {.name = "netCDF",
       .endings = {".nc", ".nc4", ".cdf", ".netcdf"},
       .has_field_names = true,
       .is_content = IsNetcdf,
       .open_as = [](const std::string& file, const std::string& /*field*/, const std::string& part,
                     const GridRules& rules,
                     const std::string& axes) { return OpenNetcdfSeries(file, part, rules, axes); },
       .open_by_rules = [](const std::string& file, const std::string& /*field*/,
                           const std::string& part,
                           const GridRules& rules) { return OpenNetcdfSeries(file, part, rules); },
       .find_files = FilesOfNetcdf},
  };
  return *formats;
}

std::string ListedSeriesFormats() {
  std::vector<std::string> texts;
  for (const SeriesFormat& format : SeriesFormats()) {
    if (!format.endings.empty()) {
      texts.push_back(absl::StrCat(format.name, " (", absl::StrJoin(format.endings, " "), ")"));
    }
  }
  return absl::StrJoin(texts, ", ");
}

std::string FormatNameOf(const SeriesFormat& format) {
  return absl::StrReplaceAll(absl::AsciiStrToLower(format.name), {{" ", "-"}});
}

const SeriesFormat* FindSeriesFormat(absl::string_view name) {
  for (const SeriesFormat& format : SeriesFormats()) {
    if (FormatNameOf(format) == name) {
      return &format;
    }
  }
  return nullptr;
}

std::optional<SeriesFile> FindSeriesFileByName(const std::string& path) {
  for (const SeriesFormat& format : SeriesFormats()) {
    PartPath parts;
    if (SplitPartPath(path, format.endings, &parts)) {
      return SeriesFile{.format = &format, .file = parts.file, .part = parts.part};
    }
  }
  return std::nullopt;
}

std::optional<SeriesFile> FindSeriesFileByContent(const std::string& path) {
  const auto head = ReadFileStart(path, kHeadBytes);
  if (!head.ok()) {
    return std::nullopt;
  }
  for (const SeriesFormat& format : SeriesFormats()) {
    if (format.is_content != nullptr && format.is_content(head->bytes)) {
      return SeriesFile{.format = &format, .file = path, .part = ""};
    }
  }
  // Samples without a mark, beside their header. The names of .rec files are also those of MRC
  // tomograms, which have a mark.
  if (const std::string header = LayoutHeaderPath(path);
      absl::EndsWithIgnoreCase(path, ".rec") && header != path) {
    std::optional<SeriesFile> beside = FindSeriesFileByContent(header);
    if (beside.has_value()) {
      beside->file = path;
    }
    return beside;
  }
  return std::nullopt;
}

std::optional<SeriesFile> FindNiftiSibling(const std::string& header_path, const GridRules& rules) {
  std::optional<SeriesFile> file = FindSeriesFileByContent(header_path);
  if (!file.has_value() || file->format->name != kNifti1Name) {
    return file;
  }
  const bool is_named_gzip = absl::EndsWithIgnoreCase(header_path, ".gz");
  if (absl::EndsWithIgnoreCase(header_path, ".hdr.gz") ||
      is_named_gzip != IsGzipFile(header_path)) {
    return file;
  }
  const auto layout = ReadNiftiHeaderLayout(header_path);
  const bool is_ours =
      layout.ok() && ((rules.ignores_shear && layout->shear.has_value()) ||
                      (!layout->faults.ok() && layout->faults.Check(rules, header_path).ok()) ||
                      layout->wide.has_value());
  return is_ours ? std::move(file) : std::nullopt;
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenSeriesFile(const SeriesFile& file,
                                                             const std::string& field,
                                                             const GridRules& rules,
                                                             const std::string& axes) {
  if (!io::PathExists(file.file)) {
    return absl::NotFoundError(absl::StrCat(file.file, ": no such file"));
  }
  if (io::IsDirectory(file.file)) {
    return absl::InvalidArgumentError(absl::StrCat(file.file, ": a folder; expected a file"));
  }
  if (!axes.empty() && file.format->open_as == nullptr) {
    return absl::InvalidArgumentError(
        absl::StrCat(file.file, ": --axes ", axes,
                     ": the axes of this kind of file have their meaning; "
                     "--axes is for datasets of HDF5 files, for netCDF and for TIFF"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSeries> series,
                            !axes.empty()
                                ? file.format->open_as(file.file, field, file.part, rules, axes)
                            : file.format->open_by_rules != nullptr
                                ? file.format->open_by_rules(file.file, field, file.part, rules)
                                : file.format->open(file.file, field, file.part));
  return file.part.empty() ? std::move(series)
                           : SelectPart(std::move(series), file.file, file.part);
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> SelectPart(std::unique_ptr<VolumeSeries> series,
                                                         const std::string& file,
                                                         const std::string& part) {
  const std::vector<SourceField>& fields = series->fields();
  const std::optional<volume::FieldName> name =
      volume::FindFieldName(part, [&](absl::string_view text) -> std::optional<std::size_t> {
        const int field = FieldNumber(fields, text);
        return field < 0 ? std::nullopt : std::optional(static_cast<std::size_t>(field));
      });
  std::optional<int> component;
  if (name.has_value() && !name->component.empty()) {
    component = ComponentNumber(fields[name->field].components, name->component);
  }
  if (!name.has_value() || component.value_or(0) < 0) {
    return absl::NotFoundError(absl::StrFormat("%s: no %s \"%s\"; it holds %s", file,
                                               name.has_value() ? "component" : "field", part,
                                               DescribeFields(fields)));
  }
  return std::make_unique<PartSeries>(std::move(series), static_cast<int>(name->field), component);
}

std::string DescribeFields(const std::vector<SourceField>& fields) {
  constexpr std::size_t kMaxListed = 50;
  std::vector<std::string> texts;
  for (const SourceField& field : fields) {
    if (texts.size() == kMaxListed) {
      texts.emplace_back("and more");
      break;
    }
    texts.push_back(absl::StrCat(
        field.name, field.unit.empty() ? "" : absl::StrCat(" [", field.unit, "]"),
        field.components.size() > 1 ? absl::StrCat(" (", absl::StrJoin(field.components, ", "), ")")
                                    : ""));
  }
  return absl::StrJoin(texts, ", ");
}

std::string DescribeSteps(const std::vector<double>& times, const std::string& unit) {
  return times.empty() ? "1, without a time"
                       : absl::StrCat(times.size(), ", from ", times.front(), " to ", times.back(),
                                      unit.empty() ? "" : " ", unit);
}

bool IsOneVolume(const VolumeSeries& series) {
  return series.fields().size() == 1 && series.fields()[0].components.size() == 1 &&
         series.step_count() == 1;
}

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenOnlyVolume(VolumeSeries& series,
                                                             const std::string& file,
                                                             bool has_parts) {
  if (IsOneVolume(series)) {
    return series.Open(0, 0, 0);
  }
  const SourceField& first = series.fields()[0];
  const std::string name =
      absl::StrCat(first.name, first.components.size() > 1 ? ":" : "", first.components[0]);
  const bool has_steps = series.step_count() > 1;
  const bool is_word = file.find_first_of(" *?[") == std::string::npos;
  const std::string typed = is_word ? file : absl::StrCat("'", file, "'");
  return absl::InvalidArgumentError(absl::StrCat(
      file, ": several volumes, of which one must be chosen; fields: ",
      DescribeFields(series.fields()), has_steps ? "; steps: " : "",
      has_steps ? DescribeSteps(series.times(), series.time_unit()) : "",
      !has_steps && has_parts ? absl::StrCat("; choose one, as in ", file, ":", name, ", or ")
                              : "; ",
      "make a dataset of all, `isoscope partition ", typed,
      " --output DIR`, and draw one of it, `isoscope render DIR --field ", name,
      has_steps ? absl::StrCat(" --step ", series.step_count() - 1, "` or `--time ",
                               series.times().back())
                : "",
      "`"));
}

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenOnlyVolume(const SeriesFile& file,
                                                             const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<VolumeSeries> series,
                            OpenSeriesFile(file, FieldNameOf(file.file), rules));
  return OpenOnlyVolume(*series, file.file, true);
}

}  // namespace isoscope::source
