#include "core/formats/open_volume.h"

#include <functional>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/formats/dicom/dicom_folder.h"
#include "core/formats/dicom/dicom_source.h"
#include "core/formats/format_table.h"
#include "core/formats/hdf5/hdf5_file_series.h"
#include "core/formats/hdf5/hdf5_links.h"
#include "core/formats/hdf5/hdf5_series.h"
#include "core/formats/hdf5/hdf5_source.h"
#include "core/formats/medical/sample_series.h"
#include "core/formats/netcdf/netcdf_series.h"
#include "core/formats/refused_formats.h"
#include "core/formats/stacks/image_slices.h"
#include "core/formats/stacks/tiff_source.h"
#include "core/formats/vtk/vtk_image.h"
#include "core/formats/vtk/vtk_series.h"
#include "core/source/bytes/part_path.h"
#include "core/source/series_parts.h"
#include "core/source/single_series.h"

namespace isoscope::source {
namespace {

// The variables of a file that netCDF-4 wrote; null if it did not, or none is a volume.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenAsNetcdf(const Hdf5Path& path,
                                                           const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(const bool is_netcdf, IsWrittenByNetcdf(path.file));
  if (!is_netcdf) {
    return nullptr;
  }
  auto series = OpenNetcdfSeries(path.file, path.dataset, rules);
  if (absl::IsInvalidArgument(series.status()) && path.dataset.empty()) {
    return nullptr;
  }
  ISOSCOPE_RETURN_IF_ERROR(series.status());
  return path.dataset.empty() ? *std::move(series)
                              : SelectPart(*std::move(series), path.file, path.dataset);
}

// What the files say of their meshes, or netCDF's variables; null if the path names a dataset, or
// if there are none.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenMeshesOrVariables(const Hdf5Path& path,
                                                                    bool is_pattern,
                                                                    const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSeries> meshes, OpenHdf5Meshes(path, rules));
  const bool names_dataset = path.dataset.starts_with('/');
  return meshes != nullptr || names_dataset || is_pattern ? std::move(meshes)
                                                          : OpenAsNetcdf(path, rules);
}

// The meshes of the files, if they have some and the path names no dataset; else a dataset.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenHdf5Path(const std::string& path,
                                                           const SeriesOptions& options) {
  Hdf5Path parts;
  ISOSCOPE_CHECK(SplitHdf5Path(path, &parts));
  ISOSCOPE_ASSIGN_OR_RETURN(const auto pattern_files, FilesOfHdf5Pattern(parts.file));
  if (pattern_files.has_value() && !options.axes.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": --axes ", options.axes,
        ": a pattern of HDF5 files is for meshes, whose axes have their meaning; --axes is for a "
        "dataset of one file"));
  }
  if (options.axes.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        std::unique_ptr<VolumeSeries> meshes,
        OpenMeshesOrVariables(parts, pattern_files.has_value(), options.rules));
    if (meshes != nullptr) {
      return meshes;
    }
  }
  return OpenHdf5Series(path, options.axes, options.rules);
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> MakeSingle(
    const std::string& path, std::function<absl::StatusOr<std::unique_ptr<VolumeSource>>()> open) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> volume, open());
  return MakeSingleSeries({.path = path,
                           .field = FieldNameOf(path),
                           .volume = std::move(volume),
                           .open = std::move(open)});
}

// The dataset, or all meshes: the files of a pattern, and all that they link to.
absl::StatusOr<std::vector<std::string>> FilesOfHdf5(const std::string& path,
                                                     const FoundVolume& found,
                                                     const SeriesOptions& options) {
  // With axes any dataset of so many may be the one.
  if (found.files.size() == 1 && options.axes.empty()) {
    Hdf5Path parts;
    ISOSCOPE_CHECK(SplitHdf5Path(path, &parts));
    const bool is_pattern = parts.file != found.files.front();
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<VolumeSeries> meshes,
                              OpenMeshesOrVariables(parts, is_pattern, options.rules));
    if (meshes == nullptr) {
      return FilesOfHdf5Dataset(path);
    }
  }
  return FilesOfHdf5Trees(found.files);
}

// The collection and its steps, those of .pvti with their pieces.
absl::StatusOr<std::vector<std::string>> FilesOfPvd(const std::string& path) {
  std::vector<std::string> files = {path};
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<PvdStep> steps, ReadPvdSteps(path));
  for (const PvdStep& step : steps) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> of_step, FilesOfPvdStep(step));
    files.insert(files.end(), of_step.begin(), of_step.end());
  }
  return files;
}

// The header, and the files that it names.
absl::StatusOr<std::vector<std::string>> FilesOfSamples(FileFormat format,
                                                        const std::string& header) {
  ISOSCOPE_ASSIGN_OR_RETURN(const SampleLocation location, LocateSamples(format, header));
  std::vector<std::string> files = {header};
  if (location.files.front() != header) {
    files.insert(files.end(), location.files.begin(), location.files.end());
  }
  return files;
}

absl::StatusOr<std::vector<std::string>> FilesOfFound(const std::string& path,
                                                      const SeriesOptions& options) {
  ISOSCOPE_ASSIGN_OR_RETURN(FoundVolume found, FindVolume(path, options.format));
  switch (found.kind) {
    case SourceKind::kHdf5:
      return FilesOfHdf5(path, found, options);
    case SourceKind::kDicom:
      return DicomFilesOf(path);
    case SourceKind::kPvd:
      return FilesOfPvd(path);
    case SourceKind::kVtkImage:
      return FilesOfPvdStep({.file = found.files.front()});
    case SourceKind::kTiff:
      // The only one may have a companion that is no TIFF file.
      return found.files.size() == 1 ? FilesOfTiff(found.files.front()) : std::move(found.files);
    case SourceKind::kFormatFile:
      return found.format_file.format->find_files != nullptr
                 ? found.format_file.format->find_files(found.format_file.file)
                 : std::move(found.files);
    case SourceKind::kSampleFile:
      return FilesOfSamples(found.sample_format, found.files.front());
    case SourceKind::kImageSlices:
      break;
  }
  return std::move(found.files);
}

// Whether --axes may say what the axes mean.
bool TakesAxes(const FoundVolume& found, const std::string& axes) {
  return found.kind == SourceKind::kHdf5 || found.kind == SourceKind::kTiff ||
         (found.kind == SourceKind::kFormatFile && found.format_file.format->takes_axes) ||
         (found.kind == SourceKind::kImageSlices && axes == "Z");
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenByKind(const std::string& path,
                                                         const FoundVolume& found,
                                                         const SeriesOptions& options) {
  if (!options.axes.empty() && !TakesAxes(found, options.axes)) {
    return AxesHaveTheirMeaning(path, options.axes);
  }
  switch (found.kind) {
    case SourceKind::kTiff:
      return OpenTiffSeries(found.files, path, FieldNameOf(path), options.axes, options.rules);
    case SourceKind::kImageSlices:
      return MakeSingle(path, [path, as_neighbours = options.axes == "Z"] {
        return OpenImageSlices(path, as_neighbours);
      });
    case SourceKind::kHdf5:
      return OpenHdf5Path(path, options);
    case SourceKind::kDicom:
      return OpenDicomSteps(path, FieldNameOf(path), options.rules);
    case SourceKind::kVtkImage: {
      PartPath vtk;
      ISOSCOPE_CHECK(SplitVtkImagePath(path, &vtk));
      return OpenVtkImageSeries(vtk.file, vtk.part, options.rules);
    }
    case SourceKind::kPvd:
      return OpenPvdSeries(path, options.rules);
    case SourceKind::kFormatFile: {
      const FormatFile& file = found.format_file;
      return OpenFormatFile(*file.format,
                            {.file = file.file,
                             .field = FieldNameOf(file.part.empty() ? path : file.file),
                             .part = file.part,
                             .rules = options.rules,
                             .axes = options.axes});
    }
    case SourceKind::kSampleFile:
      break;
  }
  return OpenSampleSeries(found.sample_format, found.files.front(), path, FieldNameOf(path),
                          options.rules);
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenFoundVolume(const std::string& path,
                                                              const FoundVolume& found,
                                                              const SeriesOptions& options) {
  auto series = OpenByKind(path, found, options);
  return series.ok() ? std::move(series) : ExplainByContent(path, series.status());
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenVolumeSeries(const std::string& path,
                                                               const SeriesOptions& options) {
  const auto found = FindVolume(path, options.format);
  return found.ok() ? OpenFoundVolume(path, *found, options)
                    : ExplainByContent(path, found.status());
}

absl::StatusOr<std::vector<std::string>> FilesOfVolume(const std::string& path,
                                                       const SeriesOptions& options) {
  auto files = FilesOfFound(path, options);
  return files.ok() ? std::move(files) : ExplainByContent(path, files.status());
}

}  // namespace isoscope::source
