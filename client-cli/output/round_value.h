// Values with as many digits as people need.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_ROUND_VALUE_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_ROUND_VALUE_H_

namespace isoscope::cli {

// Returns a decimal number near `value`, at most half a thousandth of the range away: of 0 to 255
// one with a single decimal, 59.47 becomes 59.5. Near an end of the range it has more digits, so
// that it stays inside. Values that are not inside of (min, max) stay as they are.
double RoundedValue(double value, double min, double max);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_ROUND_VALUE_H_
