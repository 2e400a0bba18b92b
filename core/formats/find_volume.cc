// The order, by name and content:
//
//   a pattern ("slice*.tif")      TIFF stack
//   a folder, whatever its name   TIFF files if it has some, else a DICOM series, else slices, else
//                                 DICOM series in folders below
//   a pattern, or a slice         stack of pictures
//   file.h5:/dataset, data*.h5    HDF5
//   file.vti, file.vti:array      VTK ImageData, as are .pvti; .pvd
//   .mrc, .tif and the like       the formats of the table
//   .dcm, or the DICOM mark       the series of that file
//   .nii, .hdr, .img              NIfTI or Analyze of the table, by content
//   .nrrd, .mha, ...              NRRD, MetaImage
//   any other name                the formats of the table, by content

#include "core/formats/find_volume.h"

#include <optional>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/status_macros.h"
#include "core/formats/dicom/dicom_folder.h"
#include "core/formats/hdf5/hdf5_file_series.h"
#include "core/formats/medical/layout_formats.h"
#include "core/formats/refused_formats.h"
#include "core/formats/stacks/image_slices.h"
#include "core/formats/vtk/vtk_image.h"
#include "core/io/file.h"
#include "core/source/bytes/named_files.h"
#include "core/source/bytes/part_path.h"
#include "core/source/hdf5/hdf5_path.h"

namespace isoscope::source {
namespace {

// The readers of libraries would wait for a writer, or read without end.
absl::Status CheckIsNoSpecialFile(const std::string& path) {
  return io::IsDirectory(path) ? absl::OkStatus() : io::CheckIsRegularFile(path);
}

bool IsTiffName(const std::string& path) {
  return absl::EndsWithIgnoreCase(path, ".tif") || absl::EndsWithIgnoreCase(path, ".tiff");
}

FoundVolume FoundFormatFile(FormatFile file) {
  FoundVolume found{.kind = SourceKind::kFormatFile, .files = {file.file}};
  found.format_file = std::move(file);
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

absl::StatusOr<FoundVolume> FindNifti(const std::string& path, bool is_forced) {
  if (const std::string header = LayoutHeaderPath(path); !io::PathExists(header)) {
    return absl::NotFoundError(
        absl::StrFormat("%s: its NIfTI header %s does not exist; to read it as raw samples rename "
                        "it to end in .raw, and give --dims and --type",
                        path, header));
  }
  return FoundFormatFile(FindNiftiFile(path, is_forced));
}

// `format`: the one that it has, or not set if that is to be found out.
absl::StatusOr<FoundVolume> FindSampleFile(const std::string& path,
                                           std::optional<FileFormat> format) {
  if (!format.has_value()) {
    format = SampleFormatOf(path);
  }
  if (!format.has_value()) {
    if (std::optional<FormatFile> file = FindFormatFileByContent(path); file.has_value()) {
      return FoundFormatFile(*std::move(file));
    }
    return UnknownKindOfFile(path);
  }
  return FoundVolume{.files = {path}, .sample_format = *format};
}

// Whatever the name and the content say.
absl::StatusOr<FoundVolume> FindVolumeAs(const std::string& path, const std::string& format) {
  ISOSCOPE_RETURN_IF_ERROR(format == "dicom" && io::IsDirectory(path) ? absl::OkStatus()
                                                                      : CheckIsFile(path));
  if (const Format* const own = FindFormat(format); own != nullptr) {
    return FoundFormatFile({.format = own, .file = path, .part = ""});
  }
  if (const auto sample_format = SampleFormatFromName(format); sample_format.has_value()) {
    return FindSampleFile(path, sample_format);
  }
  if (absl::EqualsIgnoreCase(format, "nifti")) {
    return FindNifti(path, true);
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

}  // namespace

bool FoundVolume::has_field_names() const {
  return kind == SourceKind::kHdf5 || kind == SourceKind::kVtkImage || kind == SourceKind::kPvd ||
         (kind == SourceKind::kFormatFile && format_file.format->has_field_names);
}

absl::StatusOr<FoundVolume> FindVolume(const std::string& path, const std::string& format) {
  ISOSCOPE_RETURN_IF_ERROR(CheckIsNoSpecialFile(path));
  if (!format.empty()) {
    return FindVolumeAs(path, format);
  }
  const bool is_pattern = !io::PathExists(path) && path.find_first_of("*?") != path.npos;
  if (is_pattern && IsTiffName(path)) {
    return FoundVolume{.kind = SourceKind::kTiff, .files = FilesNamed(path, IsTiffName)};
  }
  if (io::IsDirectory(path)) {
    return FindInFolder(path);
  }
  if (IsImageSliceName(path) && (io::PathExists(path) || is_pattern)) {
    return FoundVolume{.kind = SourceKind::kImageSlices, .files = ImageSlicesNamed(path)};
  }
  Hdf5Path hdf5;
  if (SplitHdf5Path(path, &hdf5)) {
    ISOSCOPE_RETURN_IF_ERROR(CheckIsNoSpecialFile(hdf5.file));
    ISOSCOPE_ASSIGN_OR_RETURN(auto files, FilesOfHdf5Pattern(hdf5.file));
    return FoundVolume{.kind = SourceKind::kHdf5,
                       .files = files.value_or(std::vector<std::string>{hdf5.file})};
  }
  PartPath vtk;
  if (SplitVtkImagePath(path, &vtk)) {
    ISOSCOPE_RETURN_IF_ERROR(CheckIsFile(vtk.file));
    return FoundVolume{.kind = SourceKind::kVtkImage, .files = {vtk.file}};
  }
  if (absl::EndsWithIgnoreCase(path, ".pvd")) {
    ISOSCOPE_RETURN_IF_ERROR(CheckIsFile(path));
    return FoundVolume{.kind = SourceKind::kPvd};
  }
  if (std::optional<FormatFile> file = FindFormatFileByName(path); file.has_value()) {
    ISOSCOPE_RETURN_IF_ERROR(CheckIsFile(file->file));
    return FoundFormatFile(*std::move(file));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckIsFile(path));
  if (absl::EndsWithIgnoreCase(path, ".dcm") || IsDicomFile(path)) {
    return FoundVolume{.kind = SourceKind::kDicom};
  }
  return HasNiftiName(path) ? FindNifti(path, false) : FindSampleFile(path, std::nullopt);
}

bool NamesDicomSeries(const std::string& path) {
  const bool is_likely =
      io::IsDirectory(path) || absl::EndsWithIgnoreCase(path, ".dcm") || IsDicomFile(path);
  if (!is_likely) {
    return false;
  }
  const auto found = FindVolume(path);
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
  for (const Format& format : Formats()) {
    names.push_back({FormatNameOf(format),
                     format.endings.empty()
                         ? "by content"
                         : absl::StrCat(absl::StrJoin(format.endings, " "), format.more_names)});
  }
  return names;
}

}  // namespace isoscope::source
