// The table of formats: a row each, in the order in which they are asked whether a path is theirs.
// Opening, --format, --list-formats, messages and the table of docs/formats.md follow from it. A
// new format is one room beside this file and one row.

#ifndef ISOSCOPE_CORE_FORMATS_FORMAT_TABLE_H_
#define ISOSCOPE_CORE_FORMATS_FORMAT_TABLE_H_

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/types/span.h"

#include "core/source/grid/grid_rules.h"
#include "core/source/series_entry.h"
#include "core/source/volume_series.h"
#include "core/volume/label.h"

namespace isoscope::source {

// The files that a path names, and the flags to read them by.
struct FileRequest {
  std::string path;                  // as it was given
  std::string file;                  // the path without its part
  std::string part{};                // a field ("velocity"), or a component ("velocity:y"); "": all
  std::vector<std::string> files{};  // of a stack or a pattern, in order; else `file`
  std::string field{};               // the name of a field that the file does not name
  GridRules rules{};
  std::string axes{};  // as SeriesOptions::axes; "": the file says it
};

struct Format {  // NOLINT(clang-analyzer-optin.performance.Padding): members stand by topic
  absl::string_view name;              // "MRC"
  std::vector<std::string> endings{};  // in lower case: ".mrc", or HasEnding; a part may be behind
  std::string more_names{};            // what else a path may be, for people
  // --format may name it. Otherwise the path must tell the format, because it can name a part.
  bool is_forceable = true;

  bool has_field_names = false;   // else the only field has the name of the file
  absl::string_view axes_for{};   // what of it takes --axes; "": none, the files say what they mean
  absl::string_view only_axes{};  // the only ones that it takes; "": any
  bool shows_pictures = false;    // its files are pictures, which other programs show
  bool opens_archives = false;    // its files are archives, whose faults are its own to explain
  bool opens_parts = false;       // `open` takes the part; else it is one of the fields opened

  // These recognise its files beside their endings; null: not so. First, a name that tells more
  // than an ending. Its errors stop the search.
  absl::StatusOr<std::optional<FileRequest>> (*find)(const std::string& path) = nullptr;
  // Files of other formats have such names, too: theirs are those whose content is.
  bool shares_names = false;
  // The first bytes of a file, 1 KiB at most, decoded if they are compressed by gzip, are its own.
  bool (*is_content)(absl::string_view head) = nullptr;
  bool is_plain = false;  // a stream of gzip is none of its files
  // Its readers open files by OpenRandomAccessFile (core/io/file.h) alone, so that objects at an
  // address are read by ranges. Else they need `isoscope copy`.
  bool reads_addresses = false;
  // The file has a mark at another place. Goes before first bytes.
  bool (*is_marked)(const std::string& path) = nullptr;

  // Folders. A folder with its files is a volume. Null: none is.
  absl::StatusOr<std::optional<FileRequest>> (*find_in_folder)(const std::string& folder) = nullptr;
  std::string in_folder{};     // what it looks for, for people: "a DICOM series"
  bool opens_folders = false;  // whatever is in them, if it is forced
  // Returns true if folders below hold such files, which is looked for last. Null: they are not
  // looked at.
  bool (*is_below)(const std::string& folder) = nullptr;

  // Grids that are sheared or uneven are INVALID_ARGUMENT, unless the rules take them.
  absl::StatusOr<std::unique_ptr<VolumeSeries>> (*open)(const FileRequest& request) = nullptr;
  // The files of the volumes, the header first. Null: those of the request.
  absl::StatusOr<std::vector<std::string>> (*find_files)(const FileRequest& request) = nullptr;
  // The names of labels in files; null: the header file has them (source_labels.h).
  absl::StatusOr<std::vector<volume::Label>> (*read_labels)(const std::string& path) = nullptr;

  // The series among which --series chooses; null: there are none. It returns none for a path that
  // is one file of a series.
  absl::StatusOr<std::vector<SeriesEntry>> (*list_series)(const std::string& path) = nullptr;
  // A file of the series of that number or UID.
  absl::StatusOr<std::string> (*find_series_file)(const std::string& path,
                                                  const std::string& choice) = nullptr;
};

// The built-in rows.
const std::vector<Format>& Formats();

// The name for --format: "legacy-vtk" of "legacy VTK".
std::string FormatNameOf(const Format& format);
// The one of that name, in any case; null if there is none.
const Format* FindFormat(absl::string_view name, absl::Span<const Format> formats = Formats());
// "MRC (.mrc .map), ...": the formats that their endings tell, for help.
std::string ListedFormats(absl::Span<const Format> formats = Formats());

// A format of sources, as --list-formats has it.
struct FormatName {
  std::string name;          // "nrrd"
  std::string files;         // names of its files, for people: ".nrrd .nhdr"
  bool is_forceable = true;  // as Format
};
std::vector<FormatName> FormatNames(absl::Span<const Format> formats = Formats());

// The name of the only field of a file: "head" of "/d/head.nii.gz" and of the folder "/d/head/".
std::string FieldNameOf(absl::string_view path, absl::Span<const Format> formats = Formats());

// INVALID_ARGUMENT: --axes for a format whose files say what their axes mean, or that takes others.
absl::Status CheckAxes(const Format& format, const std::string& path, const std::string& axes,
                       absl::Span<const Format> formats = Formats());

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_FORMAT_TABLE_H_
