#include "client-cli/output/round_value.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"

namespace isoscope::cli {
namespace {

// The digits behind the first one that tell any two doubles apart.
constexpr int kAllDigits = 16;

// The decimal number with this many digits behind its first one; < 0: 0.
double WithDigits(double value, int digits) {
  double rounded = 0;
  return digits >= 0 && absl::SimpleAtod(absl::StrFormat("%.*e", digits, value), &rounded) ? rounded
                                                                                           : 0;
}

}  // namespace

double RoundedValue(double value, double min, double max) {
  if (value == 0 || !(min < value && value < max)) {
    return value;
  }
  // Halves first: the range of large values may be infinite.
  const double half_range = max / 2 - min / 2;
  const double step_exponent = std::floor(std::log10(half_range) + std::log10(2.0)) - 3;
  const double first_exponent = std::floor(std::log10(std::abs(value)));
  const double room = std::min(value - min, max - value);
  constexpr double kMaxShareOfRoom = 0.02;
  for (double digits = first_exponent - step_exponent; digits < kAllDigits; ++digits) {
    const double rounded = WithDigits(value, static_cast<int>(std::max(digits, -1.0)));
    if (min < rounded && rounded < max && std::abs(rounded - value) <= kMaxShareOfRoom * room) {
      return rounded;
    }
  }
  return value;
}

}  // namespace isoscope::cli
