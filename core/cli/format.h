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

// The shortest text that reads back as the same double; "nan", "inf".
std::string FormatShortest(double value);
// The same for an isovalue or a label: whole numbers up to 2^53 have all digits, and no exponent.
std::string FormatValue(double value);
// As FormatShortest for a coordinate: of one that is a float32, the text that reads back as that.
std::string FormatCoordinate(double value);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CORE_CLI_FORMAT_H_
