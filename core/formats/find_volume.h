// Finds the volume that a path names: by its name and by the content of the file, in one order for
// all callers.

#ifndef ISOSCOPE_CORE_FORMATS_FIND_VOLUME_H_
#define ISOSCOPE_CORE_FORMATS_FIND_VOLUME_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/types/span.h"

#include "core/formats/format_table.h"
#include "core/source/series_entry.h"

namespace isoscope::source {

// A row of the table, which must outlive this, and what the path names of it.
struct FoundVolume {
  const Format* format = nullptr;
  FileRequest request{};
};

// NOT_FOUND: nothing there. INVALID_ARGUMENT: unknown kind of file (lists those known, and says how
// to read it as raw); a format that does not exist; a folder without a volume, or with several
// kinds. FAILED_PRECONDITION: a pipe or a device. `format` forces one of those that FormatNames
// lists; "": name and content decide.
absl::StatusOr<FoundVolume> FindVolume(const std::string& path, absl::string_view format = "",
                                       absl::Span<const Format> formats = Formats());

// FindByName returns the row that the name tells; a mark of HDF5 is as good as a name.
// FindByContent returns the row that the content tells. Not set: no row. Errors of FindByName: no
// such file, a folder, or a special file.
absl::StatusOr<std::optional<FoundVolume>> FindByName(const std::string& path,
                                                      absl::Span<const Format> formats = Formats());
std::optional<FoundVolume> FindByContent(const std::string& path,
                                         absl::Span<const Format> formats = Formats());
// Returns true if a name says that the file has its own dimensions and type.
bool NamesFormat(const std::string& path, absl::Span<const Format> formats = Formats());

// Returns the series from which --series can choose in a folder, or at an index. Empty if the path
// names no volume of such a format, or a file of one series. Otherwise errors of the format.
absl::StatusOr<std::vector<SeriesEntry>> ListSeries(const std::string& path,
                                                    absl::Span<const Format> formats = Formats());

// Returns a file of the series of that number or UID in a folder, beside files of other formats.
// INVALID_ARGUMENT: no such series. Otherwise errors of the format.
absl::StatusOr<std::string> FindSeriesFile(const std::string& path, const std::string& choice,
                                           absl::Span<const Format> formats = Formats());

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_FIND_VOLUME_H_
