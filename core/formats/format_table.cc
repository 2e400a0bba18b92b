#include "core/formats/format_table.h"

#include <algorithm>
#include <array>
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
#include "core/formats/hdf5/hdf5_links.h"
#include "core/formats/maps/cube_series.h"
#include "core/formats/maps/mrc_series.h"
#include "core/formats/maps/vdb_series.h"
#include "core/formats/medical/layout_formats.h"
#include "core/formats/netcdf/minc_source.h"
#include "core/formats/netcdf/netcdf_series.h"
#include "core/formats/stacks/tiff_file.h"
#include "core/formats/stacks/tiff_source.h"
#include "core/formats/vtk/legacy_vtk_parser.h"
#include "core/formats/vtk/legacy_vtk_series.h"
#include "core/formats/vtk/vtk_series.h"
#include "core/io/file.h"
#include "core/source/bytes/file_layout.h"
#include "core/source/bytes/file_start.h"
#include "core/source/bytes/named_files.h"
#include "core/source/bytes/part_path.h"
#include "core/source/hdf5/hdf5_path.h"
#include "core/source/series_parts.h"
#include "core/volume/field_name.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kHeadBytes = 1024;
constexpr absl::string_view kNifti1Name = "NIfTI-1";
constexpr absl::string_view kNifti2Name = "NIfTI-2";
constexpr absl::string_view kAnalyzeName = "Analyze";

// A format whose header file says all.
template <bool (*is_content)(absl::string_view),
          absl::StatusOr<FileLayout> (*read)(const std::string&)>
Format LayoutRow(absl::string_view name, const std::vector<std::string>& endings) {
  return {.name = name,
          .endings = endings,
          .is_content = is_content,
          .open = [](const FileRequest& request) -> absl::StatusOr<std::unique_ptr<VolumeSeries>> {
            const std::string header = LayoutHeaderPath(request.file);
            ISOSCOPE_ASSIGN_OR_RETURN(FileLayout layout, read(header));
            ISOSCOPE_RETURN_IF_ERROR(layout.faults.Check(request.rules, header));
            return MakeLayoutSeries(request.file, request.field, std::move(layout), request.rules);
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

// netCDF-4 and MINC 2 are HDF5 files, which may link to others.
absl::StatusOr<std::vector<std::string>> FilesOfNetcdf(const std::string& file) {
  const absl::StatusOr<FileStart> start = ReadFileStart(file, 4);
  if (start.ok() && absl::StartsWith(start->bytes, "CDF")) {
    return std::vector<std::string>{file};
  }
  return FilesOfHdf5Trees({file});
}

}  // namespace

const std::vector<Format>& Formats() {
  static const auto* const formats = new std::vector<Format>{
      {.name = "MRC",
       .endings = {".mrc", ".mrcs", ".map", ".ccp4", ".mrc.gz", ".map.gz", ".ccp4.gz"},
       .is_content = IsMrcHeader,
       .open = [](const FileRequest& r) { return OpenMrcSeries(r.file, r.field, r.rules); }},
      {.name = "MINC",
       .endings = MincEndings(),
       .open = [](const FileRequest& r) { return OpenMincSeries(r.file, r.field); },
       .find_files = FilesOfNetcdf},
      // These three share their endings (HasNiftiName): content decides.
      LayoutRow<IsNifti1Header, ReadNiftiHeaderLayout>(kNifti1Name, {}),
      LayoutRow<IsNifti2Header, ReadNiftiHeaderLayout>(kNifti2Name, {}),
      LayoutRow<IsAnalyzeHeader, ReadAnalyzeLayout>(kAnalyzeName, {}),
      LayoutRow<IsMghHeader, ReadMghLayout>("MGH", {".mgh", ".mgz", ".mgh.gz"}),
      LayoutRow<IsAfniHeader, ReadAfniLayout>("AFNI", {".head", ".brik", ".brik.gz", ".brik.bz2"}),
      LayoutRow<IsParHeader, ReadParRecLayout>("PAR/REC", {".par"}),
      LayoutRow<IsBrukerHeader, ReadBrukerLayout>("ParaVision", {"2dseq", "visu_pars"}),
      {.name = "legacy VTK",
       .endings = {".vtk"},
       .has_field_names = true,
       .is_content = IsLegacyVtk,
       .open = [](const FileRequest& r) { return OpenLegacyVtkSeries(r.file, r.field, r.rules); }},
      {.name = "rectilinear VTK",
       .endings = {".vtr"},
       .has_field_names = true,
       .open = [](const FileRequest& r) { return OpenVtrSeries(r.file, r.rules); }},
      {.name = "Gaussian cube",
       .endings = {".cube", ".cub"},
       .open = [](const FileRequest& r) { return OpenCubeSeries(r.file, r.field); }},
      {.name = "TIFF",
       .endings = {".tif", ".tiff", ".lsm"},
       .takes_axes = true,
       .more_names = ", a folder of them, or a pattern",
       .is_content = IsTiff,
       .open =
           [](const FileRequest& r) {
             return OpenTiffSeries({r.file}, r.file, r.field, r.axes, r.rules);
           },
       .find_files = FilesOfTiff},
      {.name = "OpenVDB",
       .endings = {".vdb"},
       .has_field_names = true,
       .is_content = IsVdb,
       .open = [](const FileRequest& r) { return OpenVdbSeries(r.file, r.part, r.rules); }},
      {.name = "netCDF",
       .endings = NetcdfEndings(),
       .has_field_names = true,
       .takes_axes = true,
       .is_content = IsNetcdf,
       .open =
           [](const FileRequest& r) { return OpenNetcdfSeries(r.file, r.part, r.rules, r.axes); },
       .find_files = FilesOfNetcdf},
  };
  return *formats;
}

std::string ListedFormats() {
  std::vector<std::string> texts;
  for (const Format& format : Formats()) {
    if (!format.endings.empty()) {
      texts.push_back(absl::StrCat(format.name, " (", absl::StrJoin(format.endings, " "), ")"));
    }
  }
  return absl::StrJoin(texts, ", ");
}

std::string FormatNameOf(const Format& format) {
  return absl::StrReplaceAll(absl::AsciiStrToLower(format.name), {{" ", "-"}});
}

const Format* FindFormat(absl::string_view name) {
  for (const Format& format : Formats()) {
    if (FormatNameOf(format) == name) {
      return &format;
    }
  }
  return nullptr;
}

std::optional<FormatFile> FindFormatFileByName(const std::string& path) {
  for (const Format& format : Formats()) {
    PartPath parts;
    if (SplitPartPath(path, format.endings, &parts)) {
      return FormatFile{.format = &format, .file = parts.file, .part = parts.part};
    }
  }
  return std::nullopt;
}

std::optional<FormatFile> FindFormatFileByContent(const std::string& path) {
  const auto head = ReadFileStart(path, kHeadBytes);
  if (!head.ok()) {
    return std::nullopt;
  }
  for (const Format& format : Formats()) {
    if (format.is_content != nullptr && format.is_content(head->bytes)) {
      return FormatFile{.format = &format, .file = path, .part = ""};
    }
  }
  // Samples without a mark, beside their header. The names of .rec files are also those of MRC
  // tomograms, which have a mark.
  if (const std::string header = LayoutHeaderPath(path);
      absl::EndsWithIgnoreCase(path, ".rec") && header != path) {
    std::optional<FormatFile> beside = FindFormatFileByContent(header);
    if (beside.has_value()) {
      beside->file = path;
    }
    return beside;
  }
  return std::nullopt;
}

FormatFile FindNiftiFile(const std::string& path, bool is_forced) {
  std::optional<FormatFile> file = FindFormatFileByContent(LayoutHeaderPath(path));
  const bool is_nifti =
      file.has_value() && (file->format->name == kNifti1Name || file->format->name == kNifti2Name ||
                           file->format->name == kAnalyzeName);
  const Format* const format =
      is_nifti || (file.has_value() && !is_forced) ? file->format : FindFormat("nifti-1");
  return {.format = format, .file = path, .part = ""};
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenFormatFile(const Format& format,
                                                             const FileRequest& request) {
  ISOSCOPE_RETURN_IF_ERROR(CheckIsFile(request.file));
  if (!request.axes.empty() && !format.takes_axes) {
    return AxesHaveTheirMeaning(request.file, request.axes);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSeries> series, format.open(request));
  return request.part.empty() ? std::move(series)
                              : SelectPart(std::move(series), request.file, request.part);
}

absl::Status AxesHaveTheirMeaning(const std::string& path, const std::string& axes) {
  return absl::InvalidArgumentError(absl::StrCat(
      path, ": --axes ", axes,
      ": the axes of this kind of file have their meaning; --axes is for datasets of HDF5 files, "
      "for netCDF, for TIFF, and as --axes Z for slices in any order of numbers"));
}

std::string FieldNameOf(absl::string_view path) {
  constexpr std::array<absl::string_view, 12> kNameEndings{{".gz", ".nii", ".hdr", ".img", ".nrrd",
                                                            ".nhdr", ".mha", ".mhd", ".tif",
                                                            ".tiff", ".dcm", ".rec"}};
  absl::string_view name = path;
  while (absl::ConsumeSuffix(&name, "/")) {
  }
  name = name.substr(name.rfind('/') + 1);
  const absl::string_view whole = name;
  for (const absl::string_view ending : kNameEndings) {
    if (absl::EndsWithIgnoreCase(name, ending)) {
      name.remove_suffix(ending.size());
    }
  }
  for (const Format& format : Formats()) {
    for (const std::string& ending : format.endings) {
      if (HasEnding(std::string(name), ending)) {
        name.remove_suffix(ending.size());
      }
    }
  }
  return std::string(!name.empty() ? name : !whole.empty() ? whole : "volume");
}

}  // namespace isoscope::source
