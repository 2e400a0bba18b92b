// The headers of a FITS file: its parts (HDUs), their images, and where their samples lie.

#ifndef ISOSCOPE_CORE_FORMATS_ARRAYS_FITS_HEADER_H_
#define ISOSCOPE_CORE_FORMATS_ARRAYS_FITS_HEADER_H_

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::source {

// Values by keyword, without quotation marks and comments: of a keyword that stands there twice,
// the first one, and has_twice says so.
class FitsCards {
 public:
  // Takes one of 80 characters. INVALID_ARGUMENT: other characters than printable ASCII, or a text
  // without its end. The message is to follow a name and a colon.
  absl::Status Add(absl::string_view card);

  [[nodiscard]] bool Has(const std::string& key) const { return values_.contains(key); }
  // "" if it is absent.
  [[nodiscard]] std::string Text(const std::string& key) const;
  // INVALID_ARGUMENT: something else, or a keyword that stands there with two values.
  [[nodiscard]] absl::StatusOr<std::int64_t> Integer(const std::string& key,
                                                     std::int64_t fallback) const;
  [[nodiscard]] absl::StatusOr<double> Number(const std::string& key, double fallback) const;

 private:
  struct Value {
    std::string text;
    bool differs = false;  // a second card has another value
  };
  std::map<std::string, Value> values_;
};

struct FitsPart {
  FitsCards cards{};
  std::int64_t number = 0;           // from 0
  std::string name{};                // EXTNAME; may be empty
  bool is_image = false;             // else a table, or groups
  int bits = 8;                      // BITPIX
  std::vector<std::int64_t> axes{};  // the fastest first; none: no samples
  std::int64_t samples_start = 0;    // in the file, decoded
};

struct FitsFile {
  std::vector<FitsPart> parts{};
  bool is_gzip = false;
};

// Returns true if a file, decoded, begins as one.
bool IsFits(absl::string_view head);

// Reads the headers of all parts; of a gzip stream all is decoded up to the last one.
// INVALID_ARGUMENT: no such file, or cut within a header; a header of more than 4 MiB, more than
// 10 000 parts; cards that are missing or make no sense; bytes behind a part that are no other one.
absl::StatusOr<FitsFile> ReadFitsFile(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_ARRAYS_FITS_HEADER_H_
