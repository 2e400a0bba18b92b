// Adds a step to a number many times over, rounded each time, without doing each addition: a ray
// that skips empty blocks must find the sums of one that crosses them one by one, bit for bit.
//
// Between 2^e and 2^(e+1) doubles are the multiples of u = 2^(e-52). Let t be one of them, and the
// step m u + r, with a whole m and 0 <= r < u. As long as sums stay below 2^(e+1), each is rounded
// to t + m u, or to t + (m + 1) u, depending on r alone, unless r = u / 2. Then it is the even
// multiple of the two, and from the second sum on the increment is the same each time: to an even t
// is added the even one of m u and (m + 1) u. So all increments after two sums are equal, and n of
// them are n times one. The product and the sum are multiples of u below 2^53 u, hence exact.

#ifndef ISOSCOPE_CORE_VISIBILITY_REPEATED_SUM_H_
#define ISOSCOPE_CORE_VISIBILITY_REPEATED_SUM_H_

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

namespace isoscope::visibility {

// The exponent of a positive number, biased as in its bits; above 2046 for others.
inline std::uint64_t BiasedExponent(double value) {
  return std::bit_cast<std::uint64_t>(value) >> 52;
}

// Returns the least number with a greater exponent. REQUIRES: `value` is positive and finite.
inline double EndOfBinade(double value) {
  return std::bit_cast<double>((BiasedExponent(value) + 1) << 52);
}

// Returns t after `count` assignments t = t + step. O(binades between t and the result).
// REQUIRES: step >= 0, or NaN nowhere; count >= 0; sums are rounded to nearest, ties to even.
inline double RepeatedSum(double t, double step, std::int64_t count) {
  while (count >= 4) {
    const double first = t + step;
    const double second = first + step;
    const double third = second + step;
    count -= 3;
    t = third;
    const double increment = third - second;
    if (increment == 0 || !(third < std::numeric_limits<double>::infinity())) {
      return third;  // no further sum changes it
    }
    if (!(first >= std::numeric_limits<double>::min()) ||
        BiasedExponent(first) != BiasedExponent(third)) {
      continue;
    }
    const double end = EndOfBinade(third);
    auto jump = std::min(static_cast<double>(count), std::floor((end - third) / increment));
    if (third + jump * increment >= end) {
      jump -= 1;
    }
    t = third + jump * increment;
    count -= static_cast<std::int64_t>(jump);
  }
  for (; count > 0; --count) {
    t += step;
  }
  return t;
}

}  // namespace isoscope::visibility

#endif  // ISOSCOPE_CORE_VISIBILITY_REPEATED_SUM_H_
