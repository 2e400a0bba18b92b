// Percent-encoding: "%20" stands for a space, in addresses, lists of S3 and names of VTK.
// Source: RFC 3986, section 2.1.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_PERCENT_CODE_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_PERCENT_CODE_H_

#include <string>

#include "absl/strings/string_view.h"

namespace isoscope::source {

// Whether each '%' begins a %XX of two hexadecimal digits.
bool IsPercentEncoded(absl::string_view text);

// Replaces each %XX by its byte, any of 256. A '%' that begins none stays.
std::string PercentDecode(absl::string_view text);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_PERCENT_CODE_H_
