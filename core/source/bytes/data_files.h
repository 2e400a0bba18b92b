// The files that a header names for its samples: one, several by number, or several in a list.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_DATA_FILES_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_DATA_FILES_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::source {

// The division of the samples among files: the header's sizes, fastest first, and the number of
// axes that one file holds. "64 64 93" with two axes a file is 93 files; with three, each of any
// number of files holds as many slices of the last axis.
struct FileShares {
  std::vector<std::int64_t> sizes;
  std::int64_t axes_per_file = 0;
};

// The parts of "slice%03d.raw 1 93 1". A '%' that begins no number ("100%.raw") makes no numbered
// name.
struct NumberedName {
  std::string pattern;                // "slice%03d.raw"
  std::vector<std::int64_t> numbers;  // 1, 93, 1
};
std::optional<NumberedName> ParseNumberedName(absl::string_view text);

// All three return paths as they are opened: a relative name lies in the header's folder, and may
// lead out of it, as the formats allow. They have the order of the samples. NOT_FOUND names the
// header and the first file that does not exist. INVALID_ARGUMENT: not as many files as `shares`
// needs, or more than 100 000 (before any name is made); a step that never gets from `first` to
// `last`.
absl::StatusOr<std::vector<std::string>> SingleFile(const std::string& header_path,
                                                    absl::string_view name);
absl::StatusOr<std::vector<std::string>> ListedFiles(const std::string& header_path,
                                                     const std::vector<std::string>& names,
                                                     const FileShares& shares);
// Numbers first, first + step, ... up to `last`, or down to it if `step` is negative.
absl::StatusOr<std::vector<std::string>> NumberedFiles(const std::string& header_path,
                                                       const std::string& pattern,
                                                       std::int64_t first, std::int64_t last,
                                                       std::int64_t step, const FileShares& shares);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_DATA_FILES_H_
