#include "core/picture/linear_light.h"

namespace isoscope::picture {
namespace {

// Returns x to the power of 2.4, which is x squared times the fifth root of x squared. Newton's
// method finds the root from above; 100 steps are enough for any x > 1e-20. REQUIRES: 0 < x <= 1.
double PowerOf2Point4(double x) {
  const double square = x * x;
  double root = 1;
  for (int step = 0; step < 100; ++step) {
    const double to_the_fourth = root * root * root * root;
    root -= (to_the_fourth * root - square) / (5 * to_the_fourth);
  }
  return square * root;
}

// IEC 61966-2-1. `value` in [0, 1], as is the result.
double LightOf(double value) {
  return value <= 0.04045 ? value / 12.92 : PowerOf2Point4((value + 0.055) / 1.055);
}

LinearLightTables MakeTables() {
  LinearLightTables tables{};
  for (std::size_t value = 0; value < tables.light.size(); ++value) {
    tables.light[value] = static_cast<std::uint16_t>(
        LightOf(static_cast<double>(value) / 255) * double{kFullLight} + 0.5);
  }
  // A light gets the value whose interval [value - 1/2, value + 1/2) it lies in.
  std::size_t begin = 0;
  for (std::size_t value = 0; value < tables.light.size(); ++value) {
    const double end = value == 255
                           ? double{kFullLight} + 1
                           : LightOf((static_cast<double>(value) + 0.5) / 255) * double{kFullLight};
    std::size_t i = begin;
    for (; i < tables.srgb.size() && static_cast<double>(i) < end; ++i) {
      tables.srgb[i] = static_cast<std::uint8_t>(value);
    }
    begin = i;
  }
  return tables;
}

}  // namespace

const LinearLightTables& LinearLight() {
  static const auto* const tables = new LinearLightTables(MakeTables());
  return *tables;
}

}  // namespace isoscope::picture
