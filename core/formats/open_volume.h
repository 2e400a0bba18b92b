// The only opener: whatever a path names becomes a series. A single volume is a series of one field
// and one step.

#ifndef ISOSCOPE_CORE_FORMATS_OPEN_VOLUME_H_
#define ISOSCOPE_CORE_FORMATS_OPEN_VOLUME_H_

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/types/span.h"

#include "core/formats/find_volume.h"
#include "core/source/grid/grid_rules.h"
#include "core/source/volume_series.h"

namespace isoscope::source {

struct SeriesOptions {
  // The meaning of the axes of an array, slowest first, of the letters T C Z Y X: "TCZYX"; of the
  // planes of a TIFF stack, of T C Z with counts: "TC3Z20" (stack_layout.h). Empty: as the file
  // says.
  std::string axes;
  // A name of FormatNames; empty: as name and content say.
  std::string format{};
  GridRules rules{};
};

// Opens all that the path names. A path that names one array, component or step of a file gives a
// series of one field and one step, as does every format that holds no more. Errors as FindVolume
// and of the format: INVALID_ARGUMENT (not three-dimensional; a grid that is sheared or uneven,
// with its numbers, unless the rules take it), DATA_LOSS. Where a choice is missing (the meaning of
// axes), the error lists the choices.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenVolumeSeries(
    const std::string& path, const SeriesOptions& options = {},
    absl::Span<const Format> formats = Formats());
// The same of what FindVolume found, by the axes and the rules of the options.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenFoundVolume(
    FoundVolume found, const SeriesOptions& options, absl::Span<const Format> formats = Formats());

// Returns the files of such a series: all that decide a sample or a position. While none of them
// changes and none is added, the volumes do not change. Reads names and headers only, with the
// errors of OpenVolumeSeries that they show. The caller checks for missing files.
//
//   DICOM        all DICOM files of the folder, of any series
//   .pvd         the collection, and its steps; .pvti: with the pieces
//   HDF5         also netCDF-4 and MINC 2: with all files that links, virtual datasets and external
//                storage lead to (hdf5_links.h); a pattern: of each of its files
//   OME-TIFF     the files of the set, and the companion with the XML
//   two files    header and samples of NIfTI, Analyze, NRRD, MetaImage, AFNI, PAR/REC,
//                ParaVision, the samples in any number of files
absl::StatusOr<std::vector<std::string>> FilesOfVolume(
    const std::string& path, const SeriesOptions& options = {},
    absl::Span<const Format> formats = Formats());

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_OPEN_VOLUME_H_
