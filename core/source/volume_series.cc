#include "core/source/volume_series.h"

#include <array>
#include <optional>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"

#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/source/dicom_folder.h"
#include "core/source/dicom_source.h"
#include "core/source/hdf5_file_series.h"
#include "core/source/hdf5_series.h"
#include "core/source/hdf5_source.h"
#include "core/source/image_slices.h"
#include "core/source/itk_header.h"
#include "core/source/part_path.h"
#include "core/source/refused_formats.h"
#include "core/source/sample_location.h"
#include "core/source/sample_series.h"
#include "core/source/series_format.h"
#include "core/source/single_series.h"
#include "core/source/tiff_source.h"
#include "core/source/vtk_image.h"
#include "core/source/vtk_series.h"

namespace isoscope::source {
namespace {

// The series of the only volume of a path, in a format or, if that is "", by name and content.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenSingle(const std::string& path,
                                                         const std::string& format,
                                                         const GridRules& rules) {
  const auto open = [path, format, rules] { return OpenVolumeFile(path, format, rules); };
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> volume, open());
  std::string field = FieldNameOf(format.empty() ? volume->name() : path);
  return MakeSingleSeries(
      {.path = path, .field = std::move(field), .volume = std::move(volume), .open = open});
}

// The meshes of the files, if they have some and the path names no dataset; else a dataset.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenHdf5Path(const std::string& path,
                                                           const Hdf5Path& parts,
                                                           const std::string& axes,
                                                           const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(const auto pattern_files, FilesOfHdf5Pattern(parts.file));
  if (pattern_files.has_value() && !axes.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": --axes ", axes,
        ": a pattern of HDF5 files is for meshes, whose axes have their meaning; --axes is for a "
        "dataset of one file"));
  }
  if (axes.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSeries> meshes, OpenHdf5Meshes(parts, rules));
    if (meshes != nullptr) {
      return meshes;
    }
  }
  return OpenHdf5Series(path, axes, rules);
}

// Whatever the name and the content say.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenSeriesAs(const std::string& path,
                                                           const std::string& format,
                                                           const GridRules& rules,
                                                           const std::string& axes) {
  if (const SeriesFormat* const own = FindSeriesFormat(format); own != nullptr) {
    return OpenSeriesFile({.format = own, .file = path, .part = ""}, FieldNameOf(path), rules,
                          axes);
  }
  if (format == "dicom") {
    return OpenDicomSteps(path, FieldNameOf(path), rules);
  }
  const std::optional<FileFormat> sample_format = SampleFormatFromName(format);
  if (sample_format.has_value()) {
    const std::string header = sample_format == FileFormat::kNifti ? NiftiHeaderPath(path) : path;
    if (sample_format == FileFormat::kNifti) {
      if (const auto sibling = FindNiftiSibling(header, rules); sibling.has_value()) {
        return OpenSeriesFile(*sibling, FieldNameOf(path), rules);
      }
    }
    ISOSCOPE_ASSIGN_OR_RETURN(
        std::unique_ptr<VolumeSeries> series,
        OpenSampleSeries(*sample_format, header, path, FieldNameOf(path), rules));
    if (series != nullptr) {
      return series;
    }
  }
  return OpenSingle(path, format, rules);
}

}  // namespace

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
  for (const SeriesFormat& format : SeriesFormats()) {
    for (const std::string& ending : format.endings) {
      if (HasEnding(std::string(name), ending)) {
        name.remove_suffix(ending.size());
      }
    }
  }
  return std::string(!name.empty() ? name : !whole.empty() ? whole : "volume");
}

namespace {

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenByNameOrContent(const std::string& path,
                                                                  const SeriesOptions& options) {
  if (!options.format.empty()) {
    return OpenSeriesAs(path, options.format, options.rules, options.axes);
  }
  Hdf5Path hdf5;
  if (SplitHdf5Path(path, &hdf5)) {
    return OpenHdf5Path(path, hdf5, options.axes, options.rules);
  }
  if (const auto stack = FilesOfTiffStack(path); stack.has_value()) {
    return OpenTiffSeries(*stack, path, FieldNameOf(path), options.axes, options.rules);
  }
  std::optional<SeriesFile> file = FindSeriesFileByName(path);
  if (file.has_value()) {
    return OpenSeriesFile(*file, FieldNameOf(file->file), options.rules, options.axes);
  }
  if (options.axes == "Z" && NamesImageSlices(path)) {
    const auto open = [path] { return OpenImageSlices(path, true); };
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> volume, open());
    return MakeSingleSeries(
        {.path = path, .field = FieldNameOf(path), .volume = std::move(volume), .open = open});
  }
  if (!options.axes.empty()) {
    const bool is_file = io::PathExists(path) && !io::IsDirectory(path);
    if (is_file && !IsDicomFile(path) && !SampleFormatOf(path).has_value()) {
      file = FindSeriesFileByContent(path);
      if (file.has_value() && file->format->open_as != nullptr) {
        return OpenSeriesFile(*file, FieldNameOf(path), options.rules, options.axes);
      }
    }
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": --axes ", options.axes,
        ": the axes of this kind of file have their meaning; --axes is for datasets of HDF5 files, "
        "for netCDF, for TIFF, and as --axes Z for slices in any order of numbers"));
  }
  if (absl::EndsWithIgnoreCase(path, ".pvd")) {
    return OpenPvdSeries(path, options.rules);
  }
  PartPath vtk;
  if (SplitVtkImagePath(path, &vtk)) {
    return OpenVtkImageSeries(vtk.file, vtk.part, options.rules);
  }
  if (NamesDicomSeries(path)) {
    return OpenDicomSteps(path, FieldNameOf(path), options.rules);
  }
  const bool is_sample_file = io::PathExists(path) && !io::IsDirectory(path);
  const std::optional<FileFormat> format = is_sample_file ? SampleFormatOf(path) : std::nullopt;
  const std::string header = format == FileFormat::kNifti ? NiftiHeaderPath(path) : path;
  if (format == FileFormat::kNifti && io::PathExists(header)) {
    file = FindNiftiSibling(header, options.rules);
    if (file.has_value()) {
      return OpenSeriesFile(*file, FieldNameOf(path), options.rules);
    }
  }
  if (format.has_value() && io::PathExists(header)) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        std::unique_ptr<VolumeSeries> series,
        OpenSampleSeries(*format, header, path, FieldNameOf(path), options.rules));
    if (series != nullptr) {
      return series;
    }
  }
  if (!format.has_value() && !io::IsDirectory(path) && !IsDicomFile(path)) {
    file = FindSeriesFileByContent(path);
    if (file.has_value()) {
      return OpenSeriesFile(*file, FieldNameOf(path), options.rules);
    }
  }
  return OpenSingle(path, "", options.rules);
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenVolumeSeries(const std::string& path,
                                                               const SeriesOptions& options) {
  auto series = OpenByNameOrContent(path, options);
  return series.ok() ? std::move(series) : ExplainByContent(path, series.status());
}

}  // namespace isoscope::source
