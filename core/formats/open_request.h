// All that a user says of a source: what to open, as what, and which part of it. The cache of
// datasets, the fingerprints of volumes and the opener have it from here, so that none of them
// knows less than another.

#ifndef ISOSCOPE_CORE_FORMATS_OPEN_REQUEST_H_
#define ISOSCOPE_CORE_FORMATS_OPEN_REQUEST_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/types/span.h"

#include "core/formats/format_table.h"
#include "core/source/adapt/adjusted_source.h"
#include "core/source/adapt/placed_source.h"
#include "core/source/bytes/raw_file.h"
#include "core/source/series_selection.h"
#include "core/source/volume_series.h"

namespace isoscope::source {

// In the order in which they take effect.
struct OpenRequest {
  // A file, a folder, a pattern, a part of a file ("run.h5:/p"), or an address (address_source.h).
  std::string path;

  // How it is read.
  std::optional<RawFormat> raw{};  // not set: the file says it
  std::string format{};            // of FormatNames; "": as name and content say
  std::string dicom_series{};      // a number or a UID; "": the only one of the folder
  std::string axes{};              // as SeriesOptions::axes (open_volume.h)
  bool ignores_shear = false;      // as GridRules
  bool resamples = false;          // as GridRules
  GridOverride grid{};             // of the whole file, after resampling

  // Which of its samples.
  std::optional<SampleBox> crop{};
  std::int64_t stride = 1;
  std::optional<double> fill{};

  // Which of its volumes, and their names.
  std::vector<std::string> fields{};  // as SeriesSelection; empty: all
  std::optional<StepRange> steps{};   // not set: all
  std::optional<double> time{};       // of a source without times
  std::string label_names{};          // a file with names of labels; "": as the source says
};

// Returns a text that differs if two requests could give volumes of other samples, positions or
// names. It has all members, with links in paths resolved, and the version of the program, whose
// readers may differ. FilesOf and StampsOf tell the contents of the files. Errors as ResolvedPath.
absl::StatusOr<std::string> Describe(const OpenRequest& request);

// Opens the volumes. Errors as OpenVolumeSeries (open_volume.h), OpenRawFile, FindSeriesFile,
// AdjustSource, PlaceSource and SelectFrom. INVALID_ARGUMENT also: axes of a raw file.
absl::StatusOr<std::unique_ptr<VolumeSeries>> Open(const OpenRequest& request,
                                                   absl::Span<const Format> formats = Formats());
// The same, and looks at all files before: the series has IdentityOfStep, with the request and the
// stamps. ABORTED, of IdentityOfStep: a file has changed since it was opened. Otherwise errors as
// FilesOf, StampsOf and Describe, too.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenIdentified(
    const OpenRequest& request, absl::Span<const Format> formats = Formats());

// Returns all files that decide what Open gives, that of label_names included. While the list stays
// the same, and each of them too (StampsOf), so do the volumes. Reads names and headers only.
// Errors as Open, as far as they show.
absl::StatusOr<std::vector<std::string>> FilesOf(const OpenRequest& request,
                                                 absl::Span<const Format> formats = Formats());

// The path for ReadSourceLabels: that of the request, or a file of the series that dicom_series
// chooses. Errors as FindSeriesFile.
absl::StatusOr<std::string> PathOfLabels(const OpenRequest& request,
                                         absl::Span<const Format> formats = Formats());

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_OPEN_REQUEST_H_
