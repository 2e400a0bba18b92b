// The table of the formats that our own readers open as series, and what they have in common: how
// a path names a field, how content is recognised, what a single volume is.

#ifndef ISOSCOPE_CORE_FORMATS_FORMAT_TABLE_H_
#define ISOSCOPE_CORE_FORMATS_FORMAT_TABLE_H_

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/grid/grid_rules.h"
#include "core/source/volume_series.h"

namespace isoscope::source {

// What a row of the table opens, and how.
struct FileRequest {
  std::string file;
  std::string field{};  // the name of a field that the file does not name
  std::string part{};   // that is wanted (FormatFile), for formats whose files have several grids
  GridRules rules{};
  std::string axes{};  // as SeriesOptions::axes; "": the file says it
};

struct Format {
  absl::string_view name;            // "MRC"
  std::vector<std::string> endings;  // in lower case: ".mrc", or HasEnding; none: content decides
  bool has_field_names = false;      // else the only field has the name of the file
  bool takes_axes = false;           // else the files say what their axes mean
  absl::string_view more_names{};    // what else a path may be, for people
  // True if the first bytes of a file, 1 KiB at most, decoded if they are compressed by gzip, are
  // of this format. Null: only the name tells.
  bool (*is_content)(absl::string_view head) = nullptr;
  // Grids that are sheared or uneven are INVALID_ARGUMENT, unless the rules take them.
  absl::StatusOr<std::unique_ptr<VolumeSeries>> (*open)(const FileRequest& request) = nullptr;
  // The files of the volumes, the header first. Null: `file` alone.
  absl::StatusOr<std::vector<std::string>> (*find_files)(const std::string& file) = nullptr;
};

const std::vector<Format>& Formats();
// The name for --format: "legacy-vtk" of "legacy VTK".
std::string FormatNameOf(const Format& format);
// The one of that name; null if there is none.
const Format* FindFormat(absl::string_view name);
// "MRC (.mrc .map), ...", for messages and help.
std::string ListedFormats();

// The name of the only field of a file: "head" of "/d/head.nii.gz" and of the folder "/d/head/".
std::string FieldNameOf(absl::string_view path);

// A file of such a format, and the part of it that the path names: a field ("velocity"), or a
// component of one by name or number ("velocity:y", "velocity:1"); "" for all.
struct FormatFile {
  const Format* format = nullptr;
  std::string file;
  std::string part;
};

// Not set if the path has none of these endings, with or without a part.
std::optional<FormatFile> FindFormatFileByName(const std::string& path);
// The same by the content of an existing file; not set if it is of no such format, or can't be
// read.
std::optional<FormatFile> FindFormatFileByContent(const std::string& path);

// A file that its name, or --format nifti, says to be of NIfTI: its content, and that of the header
// beside samples, tells which version it is, or Analyze. Without `is_forced` it may be of any other
// format, too. One that is of none is the row of NIfTI-1, whose reader says why it is not.
FormatFile FindNiftiFile(const std::string& path, bool is_forced);

// Opens the file, or its part as a series of one field. NOT_FOUND: no such file; no such field or
// component (lists those there are). INVALID_ARGUMENT: axes for a format whose files say them.
// Otherwise errors of the format.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenFormatFile(const Format& format,
                                                             const FileRequest& request);

// INVALID_ARGUMENT: --axes for a file that says what its axes mean.
absl::Status AxesHaveTheirMeaning(const std::string& path, const std::string& axes);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_FORMAT_TABLE_H_
