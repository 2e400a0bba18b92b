// Text headers: lines of keys and values, as in NRRD and MetaImage.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_TEXT_HEADER_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_TEXT_HEADER_H_

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::source {

// The beginning of the file, 4 MiB at most: a header that lists 100 000 files is shorter. Of a file at
// an address, of NRRD or MetaImage, it may end soon behind the header.
// INVALID_ARGUMENT: a gzip stream.
absl::StatusOr<std::string> ReadTextHeader(const std::string& path);

// Takes the next line off `text`, from `position`, without its end ("\n" or "\r\n"). False at the
// end of the text.
bool NextLine(absl::string_view text, std::size_t* position, absl::string_view* line);

// Values by key, in any case. Keys and values lose the white space around them.
class HeaderFields {
 public:
  // `path` is for messages.
  explicit HeaderFields(std::string path) : path_(std::move(path)) {}

  void Set(absl::string_view key, absl::string_view value);
  // "" if it is absent.
  [[nodiscard]] std::string Get(const std::string& key) const;
  // An integer, `fallback` if it is absent. INVALID_ARGUMENT if it is something else.
  [[nodiscard]] absl::StatusOr<std::int64_t> GetInteger(const std::string& key,
                                                        std::int64_t fallback) const;
  // Integers apart by white space, none if it is absent. INVALID_ARGUMENT if there is anything
  // else.
  [[nodiscard]] absl::StatusOr<std::vector<std::int64_t>> GetIntegers(const std::string& key) const;

 private:
  std::string path_;
  std::map<std::string, std::string> fields_;  // keys in lower case
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_TEXT_HEADER_H_
