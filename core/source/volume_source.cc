// A path becomes a source in two steps. FindVolume decides, in this order, by name and content:
//
//   a pattern ("slice*.tif")      TIFF stack
//   file.h5:/dataset, data*.h5    HDF5
//   a folder                      TIFF files if it has some, else a DICOM series, else slices, else
//                                 DICOM series in folders below
//   file.vti, file.vti:array      VTK ImageData, as are .pvti
//   .mrc, .tif and the like       the formats of series_format.h
//   .dcm, or the DICOM mark       the series of that file
//   .nii, .nrrd, .mha, ...        NIfTI, NRRD, MetaImage: header by ITK, samples by FileSource
//   any other name                the formats of series_format.h, by content
//
// OpenVolumeFile then opens the source, and FilesOfVolume lists its files.

#include "core/source/volume_source.h"

#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/source/dicom_folder.h"
#include "core/source/dicom_source.h"
#include "core/source/file_source.h"
#include "core/source/file_start.h"
#include "core/source/hdf5_file_series.h"
#include "core/source/hdf5_links.h"
#include "core/source/hdf5_source.h"
#include "core/source/image_slices.h"
#include "core/source/itk_header.h"
#include "core/source/named_files.h"
#include "core/source/refused_formats.h"
#include "core/source/sample_location.h"
#include "core/source/sample_series.h"
#include "core/source/series_format.h"
#include "core/source/tiff_source.h"
#include "core/source/vti_source.h"
#include "core/source/vtk_image.h"
#include "core/source/vtk_series.h"

namespace isoscope::source {
namespace {

absl::Status CheckIsFile(const std::string& path) {
  if (!io::PathExists(path)) {
    return absl::NotFoundError(absl::StrCat(path, ": no such file"));
  }
  if (io::IsDirectory(path)) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": a folder; expected a file"));
  }
  return io::CheckIsRegularFile(path);
}

// The readers of libraries would wait for a writer, or read without end.
absl::Status CheckIsNoSpecialFile(const std::string& path) {
  return io::IsDirectory(path) ? absl::OkStatus() : io::CheckIsRegularFile(path);
}

bool IsTiffName(const std::string& path) {
  return absl::EndsWithIgnoreCase(path, ".tif") || absl::EndsWithIgnoreCase(path, ".tiff");
}

enum class SourceKind { kTiff, kImageSlices, kHdf5, kDicom, kVti, kPvti, kSeriesFile, kSampleFile };

// The volume that a path names.
struct FoundVolume {
  SourceKind kind = SourceKind::kSampleFile;
  // TIFF: slices from the lowest up; kSampleFile: header, then samples; kDicom: none, since each
  // file of the folder would be opened.
  std::vector<std::string> files{};
  // Set for a kSampleFile only.
  FileFormat format = FileFormat::kNifti;
  SampleLocation location{};
  SeriesFile series{};  // set for a kSeriesFile only
};

FoundVolume FoundSeries(SeriesFile series) {
  FoundVolume found{.kind = SourceKind::kSeriesFile, .files = {series.file}};
  found.series = std::move(series);
  return found;
}

absl::StatusOr<FoundVolume> FindInFolder(const std::string& path) {
  std::vector<std::string> tiff_files = FilesNamed(path, IsTiffName);
  if (!tiff_files.empty() && HasDicomFile(path)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: a folder with %d TIFF files and DICOM files: give a pattern such as '%s/*.tif', or a "
        "file of the series",
        path, tiff_files.size(), path));
  }
  if (!tiff_files.empty()) {
    return FoundVolume{.kind = SourceKind::kTiff, .files = std::move(tiff_files)};
  }
  if (HasDicomFile(path)) {
    return FoundVolume{.kind = SourceKind::kDicom};
  }
  std::vector<std::string> slices = ImageSlicesNamed(path);
  if (!slices.empty()) {
    return FoundVolume{.kind = SourceKind::kImageSlices, .files = std::move(slices)};
  }
  if (const auto why = WhyRefused(path); why.has_value()) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": ", *why));
  }
  if (HasDicomFileBelow(path)) {
    return FoundVolume{.kind = SourceKind::kDicom};
  }
  const std::string volumes = ListVolumesIn(path);
  return absl::NotFoundError(absl::StrCat(
      path, ": a folder with neither TIFF files (.tif .tiff), a DICOM series, nor slices (",
      kImageSliceEndings, ") in it",
      volumes.empty() ? "" : absl::StrCat("; it holds ", volumes, ": give such a file")));
}

// `format`: the one that it has, or not set if that is to be found out.
absl::StatusOr<FoundVolume> FindSampleFile(const std::string& path,
                                           std::optional<FileFormat> format,
                                           const GridRules& rules) {
  if (!format.has_value()) {
    format = SampleFormatOf(path);
  }
  if (!format.has_value()) {
    if (std::optional<SeriesFile> series = FindSeriesFileByContent(path); series.has_value()) {
      return FoundSeries(*std::move(series));
    }
    return UnknownKindOfFile(path);
  }
  std::string header_path = path;
  if (format == FileFormat::kNifti) {
    header_path = NiftiHeaderPath(path);
    if (!io::PathExists(header_path)) {
      return absl::NotFoundError(absl::StrFormat(
          "%s: its NIfTI header %s does not exist; to read it as raw samples rename "
          "it to end in .raw, and give --dims and --type",
          path, header_path));
    }
    if (std::optional<SeriesFile> series = FindNiftiSibling(header_path, rules);
        series.has_value()) {
      return FoundSeries(*std::move(series));
    }
  }
  ISOSCOPE_ASSIGN_OR_RETURN(SampleLocation location, LocateSamples(*format, header_path));
  std::vector<std::string> files{header_path};
  if (location.files.front() != header_path) {
    files.insert(files.end(), location.files.begin(), location.files.end());
  }
  return FoundVolume{.files = std::move(files), .format = *format, .location = std::move(location)};
}

// Whatever the name and the content say.
absl::StatusOr<FoundVolume> FindVolumeAs(const std::string& path, const std::string& format,
                                         const GridRules& rules) {
  ISOSCOPE_RETURN_IF_ERROR(format == "dicom" && io::IsDirectory(path) ? absl::OkStatus()
                                                                      : CheckIsFile(path));
  if (const SeriesFormat* const own = FindSeriesFormat(format); own != nullptr) {
    return FoundSeries({.format = own, .file = path, .part = ""});
  }
  if (const auto sample_format = SampleFormatFromName(format); sample_format.has_value()) {
    return FindSampleFile(path, sample_format, rules);
  }
  if (format == "dicom") {
    return FoundVolume{.kind = SourceKind::kDicom};
  }
  std::vector<std::string> names;
  for (const FormatName& known : FormatNames()) {
    if (known.is_forceable) {
      names.push_back(known.name);
    }
  }
  return absl::InvalidArgumentError(
      absl::StrFormat("--format %s: expected one of %s", format, absl::StrJoin(names, ", ")));
}

absl::StatusOr<FoundVolume> FindVolume(const std::string& path, const std::string& format,
                                       const GridRules& rules = {}) {
  ISOSCOPE_RETURN_IF_ERROR(CheckIsNoSpecialFile(path));
  if (!format.empty()) {
    return FindVolumeAs(path, format, rules);
  }
  Hdf5Path hdf5;
  if (!io::PathExists(path) && IsTiffName(path) && path.find_first_of("*?") != path.npos) {
    return FoundVolume{.kind = SourceKind::kTiff, .files = FilesNamed(path, IsTiffName)};
  }
  if (IsImageSliceName(path) && (io::PathExists(path) || path.find_first_of("*?") != path.npos)) {
    return FoundVolume{.kind = SourceKind::kImageSlices, .files = ImageSlicesNamed(path)};
  }
  if (SplitHdf5Path(path, &hdf5)) {
    ISOSCOPE_RETURN_IF_ERROR(CheckIsNoSpecialFile(hdf5.file));
    ISOSCOPE_ASSIGN_OR_RETURN(auto files, FilesOfHdf5Pattern(hdf5.file));
    return FoundVolume{.kind = SourceKind::kHdf5,
                       .files = files.value_or(std::vector<std::string>{hdf5.file})};
  }
  if (io::IsDirectory(path)) {
    return FindInFolder(path);
  }
  PartPath vti;
  if (SplitVtiPath(path, &vti)) {
    ISOSCOPE_RETURN_IF_ERROR(CheckIsFile(vti.file));
    return FoundVolume{.kind = SourceKind::kVti, .files = {vti.file}};
  }
  if (SplitVtkImagePath(path, &vti)) {  // not a .vti
    ISOSCOPE_RETURN_IF_ERROR(CheckIsFile(vti.file));
    ISOSCOPE_ASSIGN_OR_RETURN(std::vector<std::string> files, FilesOfPvti(vti.file));
    return FoundVolume{.kind = SourceKind::kPvti, .files = std::move(files)};
  }
  if (std::optional<SeriesFile> series = FindSeriesFileByName(path); series.has_value()) {
    ISOSCOPE_RETURN_IF_ERROR(CheckIsFile(series->file));
    return FoundSeries(*std::move(series));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckIsFile(path));
  if (absl::EndsWithIgnoreCase(path, ".dcm") || IsDicomFile(path)) {
    return FoundVolume{.kind = SourceKind::kDicom};
  }
  return FindSampleFile(path, std::nullopt, rules);
}

// The meshes of an HDF5 file or pattern, unless the path names a dataset; null if it has none.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenMeshesOf(const std::string& path,
                                                           const GridRules& rules) {
  Hdf5Path hdf5;
  ISOSCOPE_CHECK(SplitHdf5Path(path, &hdf5));
  return OpenHdf5Meshes(hdf5, rules);
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

// The files of a dataset, or of all meshes: those of a pattern, and all that they link to.
absl::StatusOr<std::vector<std::string>> FilesOfHdf5(const std::string& path,
                                                     const std::vector<std::string>& found,
                                                     const GridRules& rules,
                                                     const std::string& axes) {
  // With axes any dataset of so many may be the one.
  if (found.size() == 1 && axes.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<VolumeSeries> meshes,
                              OpenMeshesOf(path, rules));
    if (meshes == nullptr) {
      return FilesOfHdf5Dataset(path);
    }
  }
  return FilesOfHdf5Trees(found);
}

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenFound(const std::string& path,
                                                        const std::string& format,
                                                        const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(FoundVolume found, FindVolume(path, format, rules));
  switch (found.kind) {
    case SourceKind::kTiff: {
      ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<VolumeSeries> series,
                                OpenTiffSeries(found.files, path, FieldNameOf(path), "", rules));
      return OpenOnlyVolume(*series, path, false);
    }
    case SourceKind::kImageSlices:
      return OpenImageSlices(path);
    case SourceKind::kHdf5: {
      ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<VolumeSeries> meshes,
                                OpenMeshesOf(path, rules));
      return meshes != nullptr ? OpenOnlyVolume(*meshes, meshes->name(), true)
                               : OpenHdf5Dataset(path, rules);
    }
    case SourceKind::kDicom:
      return OpenDicomSeries(path, rules);
    case SourceKind::kVti:
      return OpenVtiFile(path, rules);
    case SourceKind::kPvti: {
      PartPath pvti;
      ISOSCOPE_CHECK(SplitVtkImagePath(path, &pvti));
      ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<VolumeSeries> series,
                                OpenVtkImageSeries(pvti.file, pvti.part, rules));
      return OpenOnlyVolume(*series, pvti.file, true);
    }
    case SourceKind::kSeriesFile:
      return OpenOnlyVolume(found.series, rules);
    case SourceKind::kSampleFile:
      break;
  }
  // Several volumes, or 64-bit integers in NRRD, which ITK does not read.
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::unique_ptr<VolumeSeries> series,
      OpenSampleSeries(found.format, found.files.front(), path, FieldNameOf(path), rules));
  if (series != nullptr) {
    return OpenOnlyVolume(*series, path, false);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const ImageHeader header,
                            ReadImageHeader(found.format, found.files.front()));
  if (found.format != FileFormat::kNifti) {
    found.location.stored_type = header.type;
  }
  return MakeFileSource(header.geometry, found.location, path, header.patient_frame);
}

absl::StatusOr<std::vector<std::string>> FilesOfFound(const std::string& path,
                                                      const std::string& format,
                                                      const GridRules& rules,
                                                      const std::string& axes) {
  if (absl::EndsWithIgnoreCase(path, ".pvd")) {
    ISOSCOPE_RETURN_IF_ERROR(CheckIsFile(path));
    return FilesOfPvd(path);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(FoundVolume found, FindVolume(path, format, rules));
  if (found.kind == SourceKind::kHdf5) {
    return FilesOfHdf5(path, found.files, rules, axes);
  }
  // The only one may have a companion that is no TIFF file.
  if (found.kind == SourceKind::kTiff && found.files.size() == 1) {
    return FilesOfTiff(found.files.front());
  }
  if (found.kind == SourceKind::kDicom) {
    return DicomFilesOf(path);
  }
  if (found.kind == SourceKind::kSeriesFile && found.series.format->find_files != nullptr) {
    return found.series.format->find_files(found.series.file);
  }
  return std::move(found.files);
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenVolumeFile(const std::string& path,
                                                             const std::string& format,
                                                             const GridRules& rules) {
  auto volume = OpenFound(path, format, rules);
  return volume.ok() ? std::move(volume) : ExplainByContent(path, volume.status());
}

absl::StatusOr<std::vector<std::string>> FilesOfVolume(const std::string& path,
                                                       const std::string& format,
                                                       const GridRules& rules,
                                                       const std::string& axes) {
  auto files = FilesOfFound(path, format, rules, axes);
  return files.ok() ? std::move(files) : ExplainByContent(path, files.status());
}

std::optional<std::vector<std::string>> FilesOfTiffStack(const std::string& path) {
  if (io::PathExists(path) && !io::IsDirectory(path)) {
    return std::nullopt;
  }
  auto found = FindVolume(path, "");
  if (!found.ok() || found->kind != SourceKind::kTiff) {
    return std::nullopt;
  }
  return std::move(found->files);
}

bool NamesImageSlices(const std::string& path) {
  const auto found = FindVolume(path, "");
  return found.ok() && found->kind == SourceKind::kImageSlices;
}

bool NamesDicomSeries(const std::string& path) {
  const bool is_likely =
      io::IsDirectory(path) || absl::EndsWithIgnoreCase(path, ".dcm") || IsDicomFile(path);
  if (!is_likely) {
    return false;
  }
  const auto found = FindVolume(path, "");
  return found.ok() && found->kind == SourceKind::kDicom;
}

std::vector<FormatName> FormatNames() {
  std::vector<FormatName> names = {
      {"nifti", ".nii .nii.gz .hdr .hdr.gz .img .img.gz"},
      {"nrrd", ".nrrd .nhdr"},
      {"metaimage", ".mha .mhd"},
      {"dicom", "a folder of a series, or a file of it"},
      {"vti", "file.vti[:array[:component]], .pvti, .pvd", false},
      {"slices", absl::StrCat(kImageSliceEndings, ": a folder of them, or a pattern"), false},
      {"hdf5", "file.h5:/dataset, .vtkhdf, .ims, openPMD: file.h5, or a pattern", false}};
  for (const SeriesFormat& format : SeriesFormats()) {
    names.push_back({FormatNameOf(format),
                     format.endings.empty()
                         ? "by content"
                         : absl::StrCat(absl::StrJoin(format.endings, " "), format.more_names)});
  }
  return names;
}

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenRawFile(const std::string& path,
                                                          const RawFormat& format) {
  ISOSCOPE_RETURN_IF_ERROR(CheckIsFile(path));
  if (format.header_bytes < 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: --header-bytes %d: expected 0 or more", path, format.header_bytes));
  }
  const volume::GridGeometry geometry{
      .sample_dims = format.dims, .spacing = {1, 1, 1}, .origin = {}, .direction = {}};
  return MakeFileSource(geometry,
                        {.files = {path},
                         .offset = format.header_bytes,
                         .is_big_endian = format.is_big_endian,
                         .stored_type = format.type},
                        path);
}

}  // namespace isoscope::source
