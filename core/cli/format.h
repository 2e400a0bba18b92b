// Numbers, sizes and times as text for people.

#ifndef ISOSCOPE_CORE_CLI_FORMAT_H_
#define ISOSCOPE_CORE_CLI_FORMAT_H_

#include <cstdint>
#include <string>

#include "absl/time/time.h"

namespace isoscope::cli {

// "-1,234,567".
std::string FormatCount(std::int64_t value);
// "1,234.5 MiB"; always MiB, one decimal.
std::string FormatMebibytes(std::int64_t bytes);
// "1,234.5": milliseconds, one decimal.
std::string FormatMilliseconds(double milliseconds);
// "41 s", "3 min 05 s", "2 h 07 min"; >= 0.
std::string FormatElapsed(absl::Duration duration);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CORE_CLI_FORMAT_H_
