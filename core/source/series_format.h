// The table of the formats that our own readers open as series, and what they have in common: how
// a path names a field, how content is recognised, what a single volume is.

#ifndef ISOSCOPE_CORE_SOURCE_SERIES_FORMAT_H_
#define ISOSCOPE_CORE_SOURCE_SERIES_FORMAT_H_

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/grid_rules.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"

namespace isoscope::source {

struct SeriesFormat {
  absl::string_view name;            // "MRC"
  std::vector<std::string> endings;  // in lower case: ".mrc", or HasEnding; none: content decides
  bool has_field_names = false;      // else the only field has the name of the file
  absl::string_view more_names{};    // what else a path may be, for people
  // True if the first bytes of a file, 1 KiB at most, decoded if they are compressed by gzip, are
  // of this format. Null: only the name tells.
  bool (*is_content)(absl::string_view head) = nullptr;
  // `field` is the name of a field that the file does not name; `part` is the part that is wanted
  // (SeriesFile), for formats whose files have several grids.
  absl::StatusOr<std::unique_ptr<VolumeSeries>> (*open)(const std::string& file,
                                                        const std::string& field,
                                                        const std::string& part) = nullptr;
  // The same, with the meaning of the axes (SeriesOptions). Null: the files say it.
  absl::StatusOr<std::unique_ptr<VolumeSeries>> (*open_as)(const std::string& file,
                                                           const std::string& field,
                                                           const std::string& part,
                                                           const GridRules& rules,
                                                           const std::string& axes) = nullptr;
  // In place of `open`, for formats that refuse grids which are sheared or uneven.
  absl::StatusOr<std::unique_ptr<VolumeSeries>> (*open_by_rules)(const std::string& file,
                                                                 const std::string& field,
                                                                 const std::string& part,
                                                                 const GridRules& rules) = nullptr;
  // The files of the volumes, the header first. Null: `file` alone.
  absl::StatusOr<std::vector<std::string>> (*find_files)(const std::string& file) = nullptr;
};

// The row of NIfTI-1, for files whose names do not say so.
inline constexpr absl::string_view kNifti1Name = "NIfTI-1";

const std::vector<SeriesFormat>& SeriesFormats();
// The name for --format: "legacy-vtk" of "legacy VTK".
std::string FormatNameOf(const SeriesFormat& format);
// The one of that name; null if there is none.
const SeriesFormat* FindSeriesFormat(absl::string_view name);
// "MRC (.mrc .map), ...", for messages and help.
std::string ListedSeriesFormats();

// The name of the only field of a file: "head" of "/d/head.nii.gz" and of the folder "/d/head/".
std::string FieldNameOf(absl::string_view path);

// A file of such a format, and the part of it that the path names: a field ("velocity"), or a
// component of one by name or number ("velocity:y", "velocity:1"); "" for all.
struct SeriesFile {
  const SeriesFormat* format = nullptr;
  std::string file;
  std::string part;
};

// Not set if the path has none of these endings, with or without a part.
std::optional<SeriesFile> FindSeriesFileByName(const std::string& path);
// The same by the content of an existing file; not set if it is of no such format, or can't be
// read.
std::optional<SeriesFile> FindSeriesFileByContent(const std::string& path);

// That of a header with the ending of NIfTI that our own reader takes: it is not one of NIfTI-1, it
// is in a gzip stream of its own (.hdr.gz), its name does not say whether it is one, or it has a
// shear or faults of its grid, which the rules take.
std::optional<SeriesFile> FindNiftiSibling(const std::string& header_path, const GridRules& rules);

// Opens the file, or its part as a series of one field. `field` is the name of a field that the
// file does not name. `axes` as in SeriesOptions. NOT_FOUND: no such file; no such field or
// component (lists those there are). INVALID_ARGUMENT: axes for a format whose files say them.
// Otherwise errors of the format.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenSeriesFile(const SeriesFile& file,
                                                             const std::string& field,
                                                             const GridRules& rules = {},
                                                             const std::string& axes = "");
// The part of a series of `file` that is named as in SeriesFile. Errors as OpenSeriesFile.
absl::StatusOr<std::unique_ptr<VolumeSeries>> SelectPart(std::unique_ptr<VolumeSeries> series,
                                                         const std::string& file,
                                                         const std::string& part);
// What there is to choose from, in the words of `isoscope info` and of errors:
// "p [Pa], velocity (x, y, z)", at most 50 of them.
std::string DescribeFields(const std::vector<SourceField>& fields);
// "3, from 0 to 2 s"; "1, without a time".
std::string DescribeSteps(const std::vector<double>& times, const std::string& unit);
// True if the series has one field of one component, and one step.
bool IsOneVolume(const VolumeSeries& series);
// Opens the only volume of the file or its part. INVALID_ARGUMENT: there are several (lists the
// fields and steps, and the commands and flags that choose).
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenOnlyVolume(const SeriesFile& file,
                                                             const GridRules& rules = {});
// The same of a series that is open. `file` is for messages; `has_parts`: a path can name a field
// of it.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenOnlyVolume(VolumeSeries& series,
                                                             const std::string& file,
                                                             bool has_parts);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_SERIES_FORMAT_H_
