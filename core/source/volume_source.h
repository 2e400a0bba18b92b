// A source volume, read in z-slabs.

#ifndef ISOSCOPE_CORE_SOURCE_VOLUME_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_VOLUME_SOURCE_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/source/grid_rules.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/patient_frame.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

// Thread-compatible.
class VolumeSource {
 public:
  virtual ~VolumeSource() = default;

  [[nodiscard]] virtual const volume::GridGeometry& geometry() const = 0;
  [[nodiscard]] virtual volume::ScalarType scalar_type() const = 0;
  // The meaning of the world axes on the patient; not set if the file does not say.
  [[nodiscard]] virtual std::optional<volume::PatientFrame> patient_frame() const {
    return std::nullopt;
  }
  // Path or name, for messages.
  [[nodiscard]] virtual const std::string& name() const = 0;
  // A sentence without its end, for people: how the grid differs from that of the file. Empty: it
  // does not.
  [[nodiscard]] virtual std::string note() const { return ""; }
  // True if samples are interpolated between those of the file, with holes for GridRules::fill.
  [[nodiscard]] virtual bool is_resampled() const { return false; }

  // Reads rows [begin_row, end_row), row = z * ny + y, as [row][x], x fastest, little-endian, into
  // `out`, which holds (end_row - begin_row) * nx * SizeOf(type) bytes. Runs of rows may overlap;
  // they are asked for in ascending order of begin_row within a pass, unless is_seekable(); a pass
  // may start over at 0. Memory beside `out`: memory_bytes(), however many rows.
  // INVALID_ARGUMENT if the file ends early (names bytes expected and found), DATA_LOSS if it is
  // damaged or can't be decoded.
  // REQUIRES: 0 <= begin_row < end_row <= ny * nz.
  virtual absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) = 0;

  // True if rows in any order cost no more than in ascending order.
  [[nodiscard]] virtual bool is_seekable() const { return true; }
  // Memory while it is read, for the memory limit.
  [[nodiscard]] virtual std::int64_t memory_bytes() const { return 0; }

  // Reads planes [begin_z, end_z).
  absl::Status ReadSlab(std::int64_t begin_z, std::int64_t end_z, char* out) {
    const std::int64_t rows = geometry().sample_dims.y;
    return ReadRows(begin_z * rows, end_z * rows, out);
  }
};

// What a file without a header does not say. Its samples lie 1 world unit apart, the first one at
// 0, 0, 0; placed_source.h changes that.
struct RawFormat {
  math::Index3 dims;
  volume::ScalarType type = volume::ScalarType::kUint8;
  bool is_big_endian = false;
  std::int64_t header_bytes = 0;
};

// Opens NIfTI (.nii .hdr .img, each also .gz), NRRD (.nrrd .nhdr), MetaImage (.mha .mhd), the
// latter two with samples in one file or several; an array of a VTK ImageData file ("file.vti",
// "file.vti:array", "file.vti:array:component"), of points or cells, and .pvti alike; a dataset of
// an HDF5 file ("file.h5:/dataset"), or the only mesh of one or of a pattern (hdf5_file_series.h);
// a DICOM series (its folder or a file of it); a TIFF stack (a folder, a pattern with '*' or '?', a
// file of many pages); the only volume of a file, or of a part of it, in a format of
// series_format.h. NOT_FOUND, INVALID_ARGUMENT (unknown format: lists those known, and says how to
// read it as raw; not three-dimensional; more than one component), DATA_LOSS.
// `format` forces one of those that FormatNames lists; "": name and content decide. A grid that is
// sheared or uneven is INVALID_ARGUMENT, with its numbers, unless the rules take it.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenVolumeFile(const std::string& path,
                                                             const std::string& format = "",
                                                             const GridRules& rules = {});
// Returns the files of such a volume, or of a series (volume_series.h): all that decide a sample or
// a position. While none of them changes and none is added, the volume does not change. Reads names
// and headers only, with the errors of OpenVolumeFile that they show. The caller checks for missing
// files.
//
//   DICOM        all DICOM files of the folder, of any series
//   .pvd         the collection, and its steps; .pvti: with the pieces
//   HDF5         also netCDF-4 and MINC 2: with all files that links, virtual datasets and external
//                storage lead to (hdf5_links.h); a pattern: of each of its files
//   OME-TIFF     the files of the set, and the companion with the XML
//   two files    header and samples of NIfTI, Analyze, NRRD, MetaImage, AFNI, PAR/REC, ParaVision,
//                Stimulate, the samples in any number of files
// `axes`: as SeriesOptions::axes, which may choose another dataset.
absl::StatusOr<std::vector<std::string>> FilesOfVolume(const std::string& path,
                                                       const std::string& format = "",
                                                       const GridRules& rules = {},
                                                       const std::string& axes = "");
// The files of a TIFF stack of many files: a folder of them, or a pattern, which may name none. Not
// set if the path is neither.
std::optional<std::vector<std::string>> FilesOfTiffStack(const std::string& path);
// Whether the path names a stack of images (image_slices.h): a folder of them, or a pattern.
bool NamesImageSlices(const std::string& path);
// Whether the path names a DICOM series: a folder that holds one and no TIFF files, or a file of
// it.
bool NamesDicomSeries(const std::string& path);

// A format of sources.
struct FormatName {
  std::string name;   // "nrrd"
  std::string files;  // names of its files, for people: ".nrrd .nhdr"
  bool is_forceable =
      true;  // else the name must say it, because a path can name a part of the file
};
std::vector<FormatName> FormatNames();

// Opens a raw file. INVALID_ARGUMENT if it is smaller than the flags promise (names both sizes).
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenRawFile(const std::string& path,
                                                          const RawFormat& format);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_VOLUME_SOURCE_H_
