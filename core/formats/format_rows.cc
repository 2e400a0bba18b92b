// The built-in rows of the table of formats (format_table.h). A row names functions, which the
// adapters of this file make of those of the format's room:
//
//   find, find_in_folder   whether a path or a folder is of the format; then the file, its part
//                          ("run.h5:/p") and the files of a stack
//   is_content             whether the first bytes of a file are of the format
//   open                   makes a series of the found file
//   find_files             lists all files that decide the samples; null: the found ones
//
// Rows are asked in order. The adapters stand in front of the table, grouped by format.

#include <algorithm>
#include <cstddef>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

#include "core/base/status_macros.h"
#include "core/formats/address_source.h"
#include "core/formats/arrays/fits_header.h"
#include "core/formats/arrays/fits_series.h"
#include "core/formats/arrays/npy_series.h"
#include "core/formats/dicom/dicom_archive.h"
#include "core/formats/dicom/dicom_folder.h"
#include "core/formats/dicom/dicom_labels.h"
#include "core/formats/dicom/dicom_source.h"
#include "core/formats/format_table.h"
#include "core/formats/hdf5/hdf5_file_series.h"
#include "core/formats/hdf5/hdf5_links.h"
#include "core/formats/hdf5/hdf5_series.h"
#include "core/formats/hdf5/hdf5_source.h"
#include "core/formats/maps/cube_series.h"
#include "core/formats/maps/mrc_series.h"
#include "core/formats/maps/vdb_series.h"
#include "core/formats/medical/layout_formats.h"
#include "core/formats/medical/sample_format.h"
#include "core/formats/medical/sample_series.h"
#include "core/formats/netcdf/minc_source.h"
#include "core/formats/netcdf/netcdf_series.h"
#include "core/formats/stacks/image_slices.h"
#include "core/formats/stacks/tiff_file.h"
#include "core/formats/stacks/tiff_source.h"
#include "core/formats/vtk/legacy_vtk_parser.h"
#include "core/formats/vtk/legacy_vtk_series.h"
#include "core/formats/vtk/vtk_image.h"
#include "core/formats/vtk/vtk_series.h"
#include "core/formats/vtk/vtk_steps.h"
#include "core/formats/zarr/zarr_series.h"
#include "core/io/file.h"
#include "core/io/mounted_file.h"
#include "core/source/bytes/file_layout.h"
#include "core/source/bytes/file_start.h"
#include "core/source/bytes/named_files.h"
#include "core/source/bytes/part_path.h"
#include "core/source/bytes/zip_file.h"
#include "core/source/hdf5/hdf5_path.h"
#include "core/source/series_parts.h"
#include "core/source/single_series.h"

namespace isoscope::source {
namespace {

using Series = absl::StatusOr<std::unique_ptr<VolumeSeries>>;
using Files = absl::StatusOr<std::vector<std::string>>;
using MaybeFound = absl::StatusOr<std::optional<FileRequest>>;

bool IsPattern(const std::string& path) {
  return !io::PathExists(path) && path.find_first_of("*?") != std::string::npos;
}

MaybeFound FoundFile(const std::string& path) {
  ISOSCOPE_RETURN_IF_ERROR(CheckIsFile(path));
  return FileRequest{.path = path, .file = path, .files = {path}};
}

MaybeFound FoundStack(const std::string& path, std::vector<std::string> files) {
  return FileRequest{.path = path, .file = path, .files = std::move(files)};
}

// ---- HDF5. --------------------------------------------------------------------------------------

MaybeFound FindHdf5(const std::string& path) {
  Hdf5Path hdf5;
  if (!SplitHdf5Path(path, &hdf5)) {
    return std::nullopt;
  }
  if (!io::IsDirectory(hdf5.file)) {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckIsRegularFile(hdf5.file));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(auto files, FilesOfHdf5Pattern(hdf5.file));
  return FileRequest{.path = path,
                     .file = hdf5.file,
                     .part = hdf5.dataset,
                     .files = files.value_or(std::vector<std::string>{hdf5.file})};
}

bool IsHdf5Pattern(const FileRequest& request) {
  return request.files != std::vector<std::string>{request.file};
}

// The variables of a file that netCDF-4 wrote; null if it did not, or none is a volume.
Series OpenAsNetcdf(const FileRequest& request) {
  ISOSCOPE_ASSIGN_OR_RETURN(const bool is_netcdf, IsWrittenByNetcdf(request.file));
  if (!is_netcdf) {
    return nullptr;
  }
  auto series = OpenNetcdfSeries(request.file, request.part, request.rules);
  if (absl::IsInvalidArgument(series.status()) && request.part.empty()) {
    return nullptr;
  }
  ISOSCOPE_RETURN_IF_ERROR(series.status());
  return request.part.empty() ? *std::move(series)
                              : SelectPart(*std::move(series), request.file, request.part);
}

// Opens the meshes that the files describe, else netCDF's variables. Null if the path names a
// dataset, or if there are none.
Series OpenMeshesOrVariables(const FileRequest& request) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSeries> meshes,
                            OpenHdf5Meshes({request.file, request.part}, request.rules));
  const bool names_dataset = request.part.starts_with('/');
  return meshes != nullptr || names_dataset || IsHdf5Pattern(request) ? std::move(meshes)
                                                                      : OpenAsNetcdf(request);
}

// The meshes of the files, if they have some and the path names no dataset; else a dataset.
Series OpenHdf5(const FileRequest& request) {
  if (IsHdf5Pattern(request) && !request.axes.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(
        request.path, ": --axes ", request.axes,
        ": a pattern of HDF5 files is for meshes, whose axes have their meaning; --axes is for a "
        "dataset of one file"));
  }
  if (request.axes.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSeries> meshes, OpenMeshesOrVariables(request));
    if (meshes != nullptr) {
      return meshes;
    }
  }
  return OpenHdf5Series(request.path, request.axes, request.rules);
}

// The dataset, or all meshes: the files of a pattern, and all that they link to.
Files FilesOfHdf5(const FileRequest& request) {
  if (io::IsAddressText(request.file)) {
    return std::vector<std::string>{request.file};  // it leads to no other
  }
  // With axes, any dataset with that number of axes may be the one.
  if (request.files.size() == 1 && request.axes.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<VolumeSeries> meshes,
                              OpenMeshesOrVariables(request));
    if (meshes == nullptr) {
      return FilesOfHdf5Dataset(request.path);
    }
  }
  return FilesOfHdf5Trees(request.files);
}

// netCDF-4 and MINC 2 are HDF5 files, which may link to others.
Files FilesOfNetcdf(const FileRequest& request) {
  const absl::StatusOr<FileStart> start = ReadFileStart(request.file, 4);
  if (io::IsAddressText(request.file)) {
    return std::vector<std::string>{request.file};  // it leads to no other
  }
  if (start.ok() && absl::StartsWith(start->bytes, "CDF")) {
    return std::vector<std::string>{request.file};
  }
  return FilesOfHdf5Trees({request.file});
}

// ---- VTK. ---------------------------------------------------------------------------------------

bool IsPvd(const std::string& path) { return absl::EndsWithIgnoreCase(path, ".pvd"); }

bool IsVtkImageName(const std::string& path) {
  PartPath parts;
  return SplitVtkImagePath(path, &parts) && parts.part.empty();
}

// "run_*.vti:p": each file that exists is a step.
bool IsVtkPattern(const FileRequest& request) { return IsPattern(request.file); }

MaybeFound FindVtk(const std::string& path) {
  PartPath parts;
  if (!SplitVtkImagePath(path, &parts)) {
    return IsPvd(path) || IsVtkStepList(path) ? FoundFile(path) : std::nullopt;
  }
  if (IsPattern(parts.file)) {
    return FileRequest{.path = path,
                       .file = parts.file,
                       .part = parts.part,
                       .files = FilesNamed(parts.file, IsVtkImageName)};
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckIsFile(parts.file));
  return FileRequest{.path = path, .file = parts.file, .part = parts.part, .files = {parts.file}};
}

absl::StatusOr<std::vector<PvdStep>> StepsOfVtk(const FileRequest& request) {
  return IsPvd(request.file) ? ReadPvdSteps(request.file)
         : IsVtkStepList(request.file)
             ? ReadVtkStepList(request.file)
             : StepsOfVtkFiles(request.path, request.files, request.rules);
}

bool HasVtkSteps(const FileRequest& request) {
  return IsPvd(request.file) || IsVtkStepList(request.file) || IsVtkPattern(request);
}

// A list of files at an address could name files of this machine.
absl::Status CheckVtkAtAddress(const FileRequest& request) {
  return io::IsAddressText(request.file) && !absl::EndsWithIgnoreCase(request.file, ".vti")
             ? absl::InvalidArgumentError(absl::StrCat(
                   request.file,
                   ": lists other files, which can't be read at an address; bring them all to a "
                   "folder, each with: isoscope copy ADDRESS DIR"))
             : absl::OkStatus();
}

Series OpenVtk(const FileRequest& request) {
  ISOSCOPE_RETURN_IF_ERROR(CheckVtkAtAddress(request));
  if (!HasVtkSteps(request)) {
    return OpenVtkImageSeries(request.file, request.part, request.rules);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<PvdStep> steps, StepsOfVtk(request));
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSeries> series,
                            OpenVtkSteps(request.file, std::move(steps), request.rules));
  return request.part.empty() ? std::move(series)
                              : SelectPart(std::move(series), request.file, request.part);
}

// The collection, if it is a file, and its steps, those of .pvti with their pieces.
Files FilesOfVtk(const FileRequest& request) {
  ISOSCOPE_RETURN_IF_ERROR(CheckVtkAtAddress(request));
  if (!HasVtkSteps(request)) {
    return FilesOfPvdStep({.file = request.file});
  }
  std::vector<std::string> files;
  if (!IsVtkPattern(request)) {
    files.push_back(request.file);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<PvdStep> steps, StepsOfVtk(request));
  for (const PvdStep& step : steps) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> of_step, FilesOfPvdStep(step));
    files.insert(files.end(), of_step.begin(), of_step.end());
  }
  return files;
}

// ---- Headers that say all. ----------------------------------------------------------------------

template <absl::StatusOr<FileLayout> (*read)(const std::string&)>
Series OpenLayout(const FileRequest& request) {
  const std::string header = LayoutHeaderPath(request.file);
  ISOSCOPE_ASSIGN_OR_RETURN(FileLayout layout, read(header));
  ISOSCOPE_RETURN_IF_ERROR(layout.faults.Check(request.rules, header));
  return MakeLayoutSeries(request.file, request.field, std::move(layout), request.rules);
}

// The header, and the files of its samples.
Files WithSamples(const std::string& header, const std::vector<std::string>& samples) {
  std::vector<std::string> files = {header};
  if (samples.front() != header) {
    files.insert(files.end(), samples.begin(), samples.end());
  }
  return files;
}

template <absl::StatusOr<FileLayout> (*read)(const std::string&)>
Files FilesOfLayout(const FileRequest& request) {
  const std::string header = LayoutHeaderPath(request.file);
  ISOSCOPE_ASSIGN_OR_RETURN(const FileLayout layout, read(header));
  return WithSamples(header, layout.location.files);
}

template <absl::StatusOr<FileLayout> (*read)(const std::string&)>
Format LayoutRow(absl::string_view name, bool (*is_content)(absl::string_view),
                 const std::vector<std::string>& endings = {}) {
  return {.name = name,
          .endings = endings,
          .is_content = is_content,
          .reads_addresses = true,
          .open = OpenLayout<read>,
          .find_files = FilesOfLayout<read>};
}

// The content says which version of NIfTI a file is, or Analyze. The reader of NIfTI says of others
// why they are not.
absl::StatusOr<FileLayout> ReadNiftiOrAnalyze(const std::string& header) {
  constexpr std::size_t kNiftiHeadBytes = 1024;
  const auto head = ReadFileStart(header, kNiftiHeadBytes);
  const bool is_analyze = head.ok() && !IsNifti1Header(head->bytes) &&
                          !IsNifti2Header(head->bytes) && IsAnalyzeHeader(head->bytes);
  return is_analyze ? ReadAnalyzeLayout(header) : ReadNiftiHeaderLayout(header);
}

absl::Status CheckNiftiHeaderExists(const std::string& file) {
  const std::string header = LayoutHeaderPath(file);
  return io::PathExists(header)
             ? absl::OkStatus()
             : absl::NotFoundError(absl::StrFormat(
                   "%s: its NIfTI header %s does not exist; to read it as raw samples rename it to "
                   "end in .raw, and give --dims and --type",
                   file, header));
}

Series OpenNifti(const FileRequest& request) {
  ISOSCOPE_RETURN_IF_ERROR(CheckNiftiHeaderExists(request.file));
  return OpenLayout<ReadNiftiOrAnalyze>(request);
}

Files FilesOfNifti(const FileRequest& request) {
  ISOSCOPE_RETURN_IF_ERROR(CheckNiftiHeaderExists(request.file));
  return FilesOfLayout<ReadNiftiOrAnalyze>(request);
}

template <FileFormat format>
Series OpenSamples(const FileRequest& request) {
  return OpenSampleSeries(format, request.file, request.path, request.field, request.rules);
}

template <FileFormat format>
Files FilesOfSamples(const FileRequest& request) {
  ISOSCOPE_ASSIGN_OR_RETURN(const SampleLocation location, LocateSamples(format, request.file));
  return WithSamples(request.file, location.files);
}

template <bool (*has_name)(const std::string&)>
MaybeFound FindByName(const std::string& path) {
  return has_name(path) ? FoundFile(path) : std::nullopt;
}

// ---- DICOM. -------------------------------------------------------------------------------------

bool IsTiffName(const std::string& path) {
  return absl::EndsWithIgnoreCase(path, ".tif") || absl::EndsWithIgnoreCase(path, ".tiff");
}

bool HasDicomName(const std::string& path) { return absl::EndsWithIgnoreCase(path, ".dcm"); }

MaybeFound FindDicomIn(const std::string& folder) {
  if (!HasDicomFile(folder)) {
    return std::nullopt;
  }
  const std::size_t tiff_files = FilesNamed(folder, IsTiffName).size();
  return tiff_files > 0
             ? absl::InvalidArgumentError(absl::StrFormat(
                   "%s: a folder with %d TIFF files and DICOM files: give a pattern such as "
                   "'%s/*.tif', or a file of the series",
                   folder, tiff_files, folder))
             : FoundStack(folder, {});
}

absl::StatusOr<std::vector<SeriesEntry>> ListSeriesOf(const std::string& path) {
  const bool is_folder = io::IsDirectory(path) || IsDicomIndex(path);
  return is_folder ? ListDicomSeries(path) : std::vector<SeriesEntry>();
}

// ---- Stacks. ------------------------------------------------------------------------------------

MaybeFound FindTiffPattern(const std::string& path) {
  return IsPattern(path) && IsTiffName(path) ? FoundStack(path, FilesNamed(path, IsTiffName))
                                             : std::nullopt;
}

MaybeFound FindTiffIn(const std::string& folder) {
  std::vector<std::string> files = FilesNamed(folder, IsTiffName);
  return files.empty() ? std::nullopt : FoundStack(folder, std::move(files));
}

// The only one may have a companion that is no TIFF file.
Files FilesOfTiffStack(const FileRequest& request) {
  return request.files.size() == 1 ? FilesOfTiff(request.files.front()) : request.files;
}

MaybeFound FindSlices(const std::string& path) {
  return IsImageSliceName(path) && (io::PathExists(path) || IsPattern(path))
             ? FoundStack(path, ImageSlicesNamed(path))
             : std::nullopt;
}

MaybeFound FindSlicesIn(const std::string& folder) {
  std::vector<std::string> files = ImageSlicesNamed(folder);
  return files.empty() ? std::nullopt : FoundStack(folder, std::move(files));
}

Series OpenSlices(const FileRequest& request) {
  const auto open = [path = request.path, as_neighbours = !request.axes.empty()] {
    return OpenImageSlices(path, as_neighbours);
  };
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> volume, open());
  return MakeSingleSeries(
      {.path = request.path, .field = request.field, .volume = std::move(volume), .open = open});
}

// ---- Zarr. --------------------------------------------------------------------------------------

MaybeFound FindZarr(const std::string& path) {
  // Other archives are of DICOM files.
  PartPath archive;
  if (SplitPartPath(path, {".zip"}, &archive) && IsZarrArchive(archive.file)) {
    return FileRequest{
        .path = path, .file = archive.file, .part = archive.part, .files = {archive.file}};
  }
  std::optional<ZarrPath> zarr = FindZarrPath(path);
  if (!zarr.has_value()) {
    return std::nullopt;
  }
  return FileRequest{.path = path,
                     .file = zarr->file,
                     .part = std::move(zarr->part),
                     .files = {std::move(zarr->file)}};
}

absl::string_view StripSlashes(absl::string_view path) {
  while (path.size() > 1 && absl::ConsumeSuffix(&path, "/")) {
  }
  return path;
}

MaybeFound FindZarrIn(const std::string& folder) {
  if (IsZarrFolder(folder)) {
    return FindZarr(folder);
  }
  return absl::EndsWithIgnoreCase(StripSlashes(folder), ".zarr")
             ? absl::InvalidArgumentError(absl::StrCat(
                   folder,
                   ": a folder with neither zarr.json nor .zgroup, .zarray or .zmetadata: "
                   "no Zarr store, or its hidden files were not copied: copy it again"))
             : MaybeFound(std::nullopt);
}

// At an address or on a disk.
absl::StatusOr<std::unique_ptr<ZarrStore>> OpenZarrStoreOf(const std::string& file) {
  return io::IsAddressText(file) ? OpenZarrAtAddress(file) : OpenLocalZarr(file);
}

Series OpenZarr(const FileRequest& request) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<ZarrStore> store, OpenZarrStoreOf(request.file));
  return OpenZarrSeries(std::move(store), request.part, request.axes, request.rules);
}

MaybeFound FindZarrAnywhere(const std::string& text) {
  if (!io::IsAddressText(text)) {
    return FindZarr(text);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string path, PathOfSource(text));
  ISOSCOPE_ASSIGN_OR_RETURN(AddressSource source, FindAtAddress(path));
  return FileRequest{.path = path, .file = std::move(source.file), .part = std::move(source.part)};
}

absl::StatusOr<std::vector<volume::Label>> ReadZarrLabels(const std::string& path) {
  const MaybeFound found = FindZarrAnywhere(path);
  if (!found.ok() || !found->has_value()) {
    return std::vector<volume::Label>();
  }
  const auto store = OpenZarrStoreOf((*found)->file);
  auto labels = store.ok() ? ZarrLabelsOf(store->get(), (*found)->part) : store.status();
  // Whoever reads its samples says why it can't be opened.
  return absl::IsInvalidArgument(labels.status()) || labels.ok() ? std::move(labels)
                                                                 : std::vector<volume::Label>();
}

Files FilesOfZarrRow(const FileRequest& request) {
  const auto find = io::IsAddressText(request.file) ? FilesOfZarrAtAddress : FilesOfZarr;
  return find(request.file, request.part, request.axes, request.rules);
}

}  // namespace

// HDF5 stands first: its mark goes before the names of all formats that are not written as HDF5.
const std::vector<Format>& Formats() {
  static const auto* const formats = new std::vector<Format>{
      {.name = "HDF5",
       .more_names = "file.h5:/dataset, .vtkhdf, .ims, openPMD: file.h5, or a pattern",
       .is_forceable = false,
       .has_field_names = true,
       .axes_for = "datasets of HDF5 files",
       .opens_parts = true,
       .find = FindHdf5,
       .reads_addresses = true,
       .open = OpenHdf5,
       .find_files = FilesOfHdf5},
      {.name = "VTI",
       .more_names = "file.vti[:array[:component]], .pvti, .pvd, .vti.series, or a pattern",
       .is_forceable = false,
       .has_field_names = true,
       .opens_parts = true,
       .find = FindVtk,
       .reads_addresses = true,
       .open = OpenVtk,
       .find_files = FilesOfVtk},
      {.name = "Zarr",
       .endings = {".ozx"},
       .more_names = "a folder or .zip of Zarr 2 or 3, OME-Zarr: folder[:array]",
       .is_forceable = false,
       .has_field_names = true,
       .axes_for = "arrays of Zarr",
       .opens_archives = true,
       .opens_parts = true,
       .find = FindZarr,
       .reads_addresses = true,
       .find_in_folder = FindZarrIn,
       .in_folder = "a Zarr store",
       .open = OpenZarr,
       .find_files = FilesOfZarrRow,
       .read_labels = ReadZarrLabels},
      {.name = "NIfTI",
       .more_names = ".nii .nii.gz .hdr .hdr.gz .img .img.gz",
       .find = FindByName<HasNiftiName>,
       .shares_names = true,
       .reads_addresses = true,
       .open = OpenNifti,
       .find_files = FilesOfNifti},
      {.name = "NRRD",
       .more_names = ".nrrd .nhdr",
       .find = FindByName<HasNrrdName>,
       .is_content = IsNrrdHeader,
       .is_plain = true,
       .reads_addresses = true,
       .open = OpenSamples<FileFormat::kNrrd>,
       .find_files = FilesOfSamples<FileFormat::kNrrd>},
      {.name = "MetaImage",
       .more_names = ".mha .mhd",
       .find = FindByName<HasMetaImageName>,
       .is_content = IsMetaImageHeader,
       .is_plain = true,
       .reads_addresses = true,
       .open = OpenSamples<FileFormat::kMetaImage>,
       .find_files = FilesOfSamples<FileFormat::kMetaImage>},
      {.name = "DICOM",
       .more_names = "a folder of a series, or a file of it",
       .find = FindByName<HasDicomName>,
       .is_marked = IsDicomFile,
       .find_in_folder = FindDicomIn,
       .in_folder = "a DICOM series",
       .opens_folders = true,
       .is_below = HasDicomFileBelow,
       .open = [](const FileRequest& r) { return OpenDicomSteps(r.path, r.field, r.rules); },
       .find_files = [](const FileRequest& r) { return DicomFilesOf(r.path); },
       .read_labels = ReadDicomLabels,
       .list_series = ListSeriesOf,
       .find_series_file = FindDicomSeriesFile},
      {.name = "MRC",
       .endings = {".mrc", ".mrcs", ".map", ".ccp4", ".mrc.gz", ".mrcs.gz", ".map.gz", ".ccp4.gz"},
       .is_content = IsMrcHeader,
       .reads_addresses = true,
       .open = [](const FileRequest& r) { return OpenMrcSeries(r.file, r.field, r.rules); }},
      {.name = "MINC",
       .endings = MincEndings(),
       .open = [](const FileRequest& r) { return OpenMincSeries(r.file, r.field); },
       .find_files = FilesOfNetcdf},
      // These three share their names: NIfTI finds them.
      LayoutRow<ReadNiftiHeaderLayout>("NIfTI-1", IsNifti1Header),
      LayoutRow<ReadNiftiHeaderLayout>("NIfTI-2", IsNifti2Header),
      LayoutRow<ReadAnalyzeLayout>("Analyze", IsAnalyzeHeader),
      LayoutRow<ReadMghLayout>("MGH", IsMghHeader, {".mgh", ".mgz", ".mgh.gz"}),
      LayoutRow<ReadAfniLayout>("AFNI", IsAfniHeader, {".head", ".brik", ".brik.gz", ".brik.bz2"}),
      LayoutRow<ReadParRecLayout>("PAR/REC", IsParHeader, {".par"}),
      LayoutRow<ReadBrukerLayout>("ParaVision", IsBrukerHeader, {"2dseq", "visu_pars"}),
      LayoutRow<ReadMrtrixLayout>("MRtrix", IsMrtrixHeader, {".mif", ".mif.gz", ".mih"}),
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
       .more_names = "a folder of them, or a pattern",
       .axes_for = "TIFF",
       .find = FindTiffPattern,
       .is_content = IsTiff,
       .reads_addresses = true,
       .find_in_folder = FindTiffIn,
       .in_folder = "TIFF files (.tif .tiff)",
       .open =
           [](const FileRequest& r) {
             return OpenTiffSeries(r.files, r.file, r.field, r.axes, r.rules);
           },
       .find_files = FilesOfTiffStack},
      {.name = "OpenVDB",
       .endings = {".vdb"},
       .has_field_names = true,
       .is_content = IsVdb,
       .open = [](const FileRequest& r) { return OpenVdbSeries(r.file, r.part, r.rules); }},
      {.name = "NumPy",
       .endings = {".npy", ".npy.gz"},
       .axes_for = "arrays of NumPy (.npy)",
       .is_content = IsNpy,
       .reads_addresses = true,
       .open = [](const FileRequest& r) { return OpenNpySeries(r.file, r.field, r.axes); }},
      {.name = "NPZ",
       .endings = {".npz"},
       .more_names = "file.npz:array",
       .has_field_names = true,
       .opens_archives = true,
       .opens_parts = true,
       .is_content = IsNpz,
       .is_plain = true,
       .open = [](const FileRequest& r) { return OpenNpzSeries(r.file, r.part); }},
      // Behind NPZ: any other ZIP archive is taken for one of DICOM files.
      {.name = "DICOM archive",
       .endings = {".zip"},
       .opens_archives = true,
       .is_content = IsZip,
       .is_plain = true,
       .open = [](const FileRequest& r) { return OpenDicomArchive(r.file, r.field, r.rules); },
       .list_series = ListDicomArchive,
       .find_series_file = [](const std::string& path,
                              const std::string& /*choice*/) -> absl::StatusOr<std::string> {
         return path;  // its rules choose
       }},
      {.name = "FITS",
       .endings = {".fits", ".fits.gz", ".fit", ".fit.gz", ".fts", ".fts.gz", ".fz"},
       .more_names = "file.fits:NAME, file.fits:1",
       .has_field_names = true,
       .opens_parts = true,
       .is_content = IsFits,
       .open =
           [](const FileRequest& r) { return OpenFitsSeries(r.file, r.part, r.field, r.rules); }},
      {.name = "netCDF",
       .endings = NetcdfEndings(),
       .has_field_names = true,
       .axes_for = "netCDF",
       .is_content = IsNetcdf,
       .reads_addresses = true,
       .open =
           [](const FileRequest& r) { return OpenNetcdfSeries(r.file, r.part, r.rules, r.axes); },
       .find_files = FilesOfNetcdf},
      {.name = "slices",
       .more_names = absl::StrCat(kImageSliceEndings, ": a folder of them, or a pattern"),
       .is_forceable = false,
       .axes_for = "slices in any order of numbers",
       .only_axes = "Z",
       .shows_pictures = true,
       .find = FindSlices,
       .find_in_folder = FindSlicesIn,
       .in_folder = absl::StrCat("slices (", kImageSliceEndings, ")"),
       .open = OpenSlices},
  };
  return *formats;
}

}  // namespace isoscope::source
