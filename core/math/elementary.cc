// Numbers of twice the precision, pairs of doubles, carry all that needs more than 53 bits:
//
//   Sin, Cos, Tan   reduce the angle by multiples of pi / 2, held in three doubles, and sum Taylor
//                   series in pairs.
//   Pow             is 2^n exp(r) with y log(x) = n' log(2) / 128 + r. log(x) takes x to within
//                   2^-7 of 1 by a table of reciprocals c and adds -log(c). Only terms that are
//                   small beside the result are single doubles: it is 2^-9 units off or less.
//   Cbrt            is one step of Newton's method from Pow(x, 1/3), its residual in pairs.
//
// The tables of Pow are made from series in pairs when they are first used: the only constants are
// integers and pi / 2.
//
// Sources: Dekker 1971, "A floating-point technique for extending the available precision"; Tang
// 1990, "Table-driven implementation of the logarithm function in IEEE floating-point arithmetic";
// Muller 2016, "Elementary functions".

#include "core/math/elementary.h"

#include <array>
#include <bit>
#include <cfloat>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

namespace isoscope::math {
namespace {

static_assert(FLT_EVAL_METHOD == 0, "doubles must be rounded after every operation");

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// The sum of two doubles, of which `high` is the double nearest the sum.
struct Pair {
  double high = 0;
  double low = 0;
};

// Returns a + b, exactly. REQUIRES: |a| >= |b|, or a is 0.
Pair SumOfOrdered(double a, double b) {
  const double sum = a + b;
  return {sum, b - (sum - a)};
}

// Returns a + b, exactly.
Pair Sum(double a, double b) {
  const double sum = a + b;
  const double b_part = sum - a;
  return {sum, (a - (sum - b_part)) + (b - b_part)};
}

// Returns a * b, exactly unless it underflows. REQUIRES: |a|, |b| < 2^996.
Pair Product(double a, double b) {
  constexpr double kSplitter = 0x1p27 + 1;
  const auto upper_half = [](double value) {
    const double scaled = kSplitter * value;
    return scaled - (scaled - value);
  };
  const double a_upper = upper_half(a);
  const double a_lower = a - a_upper;
  const double b_upper = upper_half(b);
  const double b_lower = b - b_upper;
  const double product = a * b;
  return {product, ((a_upper * b_upper - product) + a_upper * b_lower + a_lower * b_upper) +
                       a_lower * b_lower};
}

// The operations of pairs are at most 2^-102 off, relative to the larger operand of a sum.
Pair operator-(const Pair& a) { return {-a.high, -a.low}; }

Pair operator+(const Pair& a, const Pair& b) {
  const Pair high = Sum(a.high, b.high);
  const Pair low = Sum(a.low, b.low);
  const Pair sum = SumOfOrdered(high.high, high.low + low.high);
  return SumOfOrdered(sum.high, sum.low + low.low);
}

Pair operator*(const Pair& a, const Pair& b) {
  const Pair product = Product(a.high, b.high);
  return SumOfOrdered(product.high, product.low + (a.high * b.low + a.low * b.high));
}

Pair operator/(const Pair& a, const Pair& b) {
  const double first = a.high / b.high;
  const Pair rest = a + -(b * Pair{first});
  const double second = rest.high / b.high;
  const Pair rest_of_rest = rest + -(b * Pair{second});
  return SumOfOrdered(first, second) + Pair{rest_of_rest.high / b.high};
}

Pair operator/(const Pair& a, double b) {
  const double first = a.high / b;
  const Pair product = Product(first, b);
  return SumOfOrdered(first, (((a.high - product.high) - product.low) + a.low) / b);
}

// Returns the whole number nearest to `value`, halves to even: what std::rint returns, without a
// call. REQUIRES: |value| < 2^51.
double Rounded(double value) {
  constexpr double kShift = 0x1.8p52;
  return (value + kShift) - kShift;
}

// 2^exponent. REQUIRES: -1022 <= exponent <= 1023.
double PowerOfTwo(int exponent) {
  return std::bit_cast<double>(static_cast<std::uint64_t>(exponent + 1023) << 52);
}

double ToDouble(const Pair& a) { return a.high + a.low; }

// ---- Angles ----

constexpr double kMaxExactAngle = 0x1p40;
// pi / 2 is the sum of the three, to 2^-161.
constexpr double kHalfPi = 0x1.921fb54442d18p+0;
constexpr double kHalfPiMiddle = 0x1.1a62633145c07p-54;
constexpr double kHalfPiLow = -0x1.f1976b7ed8fbcp-110;
// Terms of the series: the next one is below 2^-107 for angles up to pi / 4.
constexpr int kAngleTerms = 15;

// An angle less a multiple of pi / 2: at most a little more than pi / 4.
struct ReducedAngle {
  Pair rest;
  unsigned quadrant = 0;  // the multiple, modulo 4
};

// REQUIRES: `radians` is finite.
ReducedAngle Reduce(double radians) {
  if (std::abs(radians) > kMaxExactAngle) {
    radians = std::fmod(radians, 4 * kHalfPi);
  }
  const double count = Rounded(radians / kHalfPi);
  const Pair rest = Pair{radians} + -Product(count, kHalfPi) + -Product(count, kHalfPiMiddle) +
                    Pair{-count * kHalfPiLow};
  return {rest, static_cast<unsigned>(static_cast<std::int64_t>(count) & 3)};
}

Pair SinNearZero(const Pair& x) {
  const Pair square = x * x;
  Pair sum{1};
  for (int k = kAngleTerms; k > 0; --k) {
    sum = Pair{1} + -(square * sum / ((2.0 * k) * (2.0 * k + 1)));
  }
  return x * sum;
}

Pair CosNearZero(const Pair& x) {
  const Pair square = x * x;
  Pair sum{1};
  for (int k = kAngleTerms; k > 0; --k) {
    sum = Pair{1} + -(square * sum / ((2.0 * k - 1) * (2.0 * k)));
  }
  return sum;
}

// Returns the sine of a reduced angle `quarter_turns` further on.
double SinOf(const ReducedAngle& angle, unsigned quarter_turns) {
  const unsigned quadrant = (angle.quadrant + quarter_turns) & 3;
  const double value =
      ToDouble((quadrant & 1) != 0 ? CosNearZero(angle.rest) : SinNearZero(angle.rest));
  return quadrant < 2 ? value : -value;
}

// ---- Powers ----

// exp(z) of 0 <= z <= log(2).
Pair ExpSeries(const Pair& z) {
  Pair sum{1};
  for (int k = 28; k > 0; --k) {
    sum = Pair{1} + z * sum / static_cast<double>(k);
  }
  return sum;
}

// -log(c) of 1/2 <= c <= 2: twice the series of artanh in (1 - c) / (1 + c).
Pair MinusLogSeries(double c) {
  const Pair t = Pair{1 - c} / Pair{1 + c};
  const Pair square = t * t;
  Pair sum;
  for (int k = 36; k >= 0; --k) {
    sum = square * sum + Pair{1} / (2.0 * k + 1);
  }
  return Pair{2} * t * sum;
}

// Returns `value` with its last `bits` bits 0.
double Shortened(double value, int bits) {
  return std::bit_cast<double>(std::bit_cast<std::uint64_t>(value) >> bits << bits);
}

constexpr int kSteps = 128;     // of both tables, between 1 and 2
constexpr int kFirstStep = 90;  // of mantissas: below sqrt(1/2) * kSteps
constexpr int kLastStep = 181;  // sqrt(2) * kSteps
constexpr double kMaxMantissa = static_cast<double>(kLastStep) / kSteps;
constexpr double kExpOverflow = 710;    // exp of more is infinite
constexpr double kExpUnderflow = -746;  // exp of less is 0

struct PowerTables {
  PowerTables();

  // Two tables for mantissas near step / kSteps: c, a multiple of 2^-9 near their reciprocal; and
  // -log(c).
  std::array<double, kLastStep - kFirstStep + 1> reciprocals;
  std::array<Pair, kLastStep - kFirstStep + 1> logs;
  std::array<Pair, kSteps> powers;  // 2^(step / kSteps)
  // log(2): multiples of log2_high up to 2^11, and of it over kSteps up to 2^18, are exact.
  double log2_high;
  double log2_low;
  double step_high;
  double step_low;
  double steps_per_unit;  // about kSteps / log(2)
};

PowerTables::PowerTables() {
  for (std::size_t i = 0; i < logs.size(); ++i) {
    const auto step = static_cast<double>(i + kFirstStep);
    reciprocals[i] = Rounded(512 * kSteps / step) / 512;
    logs[i] = MinusLogSeries(reciprocals[i]);
  }
  const Pair log2 = MinusLogSeries(0.5);
  log2_high = Shortened(log2.high, 11);
  log2_low = (log2.high - log2_high) + log2.low;
  const double log2_short = Shortened(log2.high, 20);
  step_high = log2_short / kSteps;
  step_low = ((log2.high - log2_short) + log2.low) / kSteps;
  steps_per_unit = kSteps / log2.high;
  for (std::size_t i = 0; i < powers.size(); ++i) {
    powers[i] = ExpSeries(log2 * Pair{static_cast<double>(i) / kSteps});
  }
}

const PowerTables& Tables() {
  static const PowerTables tables;
  return tables;
}

// log(1 + f), at most 2^-67 off, relative to the result. REQUIRES: |f| < 2^-7.
Pair LogNearOne(const Pair& f) {
  const double x = f.high;
  const Pair square = Product(x, x);
  const double higher =
      x * square.high *
      (1.0 / 3 + x * (-1.0 / 4 +
                      x * (1.0 / 5 + x * (-1.0 / 6 +
                                          x * (1.0 / 7 + x * (-1.0 / 8 +
                                                              x * (1.0 / 9 + x * (-1.0 / 10))))))));
  const Pair sum = SumOfOrdered(x, -square.high / 2);
  return SumOfOrdered(sum.high, sum.low + ((f.low - square.low / 2) - x * f.low + higher));
}

// log(x). REQUIRES: x > 0 is finite.
Pair Log(double x) {
  const PowerTables& tables = Tables();
  const bool is_subnormal = x < 0x1p-1022;
  const auto bits = std::bit_cast<std::uint64_t>(is_subnormal ? x * 0x1p54 : x);
  int exponent = static_cast<int>(bits >> 52) - (is_subnormal ? 1023 + 54 : 1023);
  double mantissa = std::bit_cast<double>((bits & 0xfffffffffffff) | 0x3ff0000000000000);
  if (mantissa >= kMaxMantissa) {
    mantissa /= 2;
    ++exponent;
  }
  const auto i = static_cast<std::size_t>(mantissa * kSteps + 0.5) - kFirstStep;
  const double c = tables.reciprocals[i];
  // Both halves of the mantissa times c are exact, and so is 1 less of the upper one.
  const double upper = Shortened(mantissa, 27);
  const Pair rest = LogNearOne(Sum(upper * c - 1, (mantissa - upper) * c));
  const auto n = static_cast<double>(exponent);
  return SumOfOrdered(n * tables.log2_high, n * tables.log2_low) + tables.logs[i] + rest;
}

// exp(z). REQUIRES: kExpUnderflow <= z.high <= kExpOverflow.
double Exp(const Pair& z) {
  const PowerTables& tables = Tables();
  const double count = Rounded(z.high * tables.steps_per_unit);
  const Pair rest = Sum(z.high - count * tables.step_high, z.low - count * tables.step_low);
  const double r = rest.high;
  // exp(r) - 1 - r, for the whole remainder r.
  const double higher =
      rest.low +
      r * r * (1.0 / 2 + r * (1.0 / 6 + r * (1.0 / 24 + r * (1.0 / 120 + r * (1.0 / 720)))));
  const auto steps = static_cast<int>(count);
  const Pair& power = tables.powers[static_cast<std::size_t>(steps & (kSteps - 1))];
  const Pair linear = Product(power.high, r);
  const Pair sum = SumOfOrdered(power.high, linear.high);
  const double value =
      sum.high + (sum.low + (power.low + linear.low + power.low * r + power.high * higher));
  const int exponent = steps >> 7;
  return exponent > -1022 && exponent < 1023 ? value * PowerOfTwo(exponent)
                                             : std::ldexp(value, exponent);
}
static_assert(kSteps == 1 << 7);

}  // namespace

double Sin(double radians) {
  if (!std::isfinite(radians)) {
    return kNan;
  }
  return radians == 0 ? radians : SinOf(Reduce(radians), 0);
}

double Cos(double radians) { return std::isfinite(radians) ? SinOf(Reduce(radians), 1) : kNan; }

double Tan(double radians) {
  if (!std::isfinite(radians)) {
    return kNan;
  }
  if (radians == 0) {
    return radians;
  }
  const ReducedAngle angle = Reduce(radians);
  const Pair sine = SinNearZero(angle.rest);
  const Pair cosine = CosNearZero(angle.rest);
  return ToDouble((angle.quadrant & 1) != 0 ? -cosine / sine : sine / cosine);
}

double Pow(double x, double y) {
  if (!(x >= 0)) {
    return kNan;
  }
  if (y == 0 || x == 1) {
    return 1;
  }
  if (x == 0) {
    return y > 0 ? 0 : kInfinity;
  }
  const Pair log = Log(x);
  const double rough = log.high * y;
  if (!(rough <= kExpOverflow)) {
    return kInfinity;
  }
  if (rough < kExpUnderflow) {
    return 0;
  }
  return Exp(log * Pair{y});
}

double Cbrt(double x) {
  if (!(x >= 0)) {
    return kNan;
  }
  if (x == 0) {
    return x;
  }
  const Pair root{Pow(x, 1.0 / 3)};
  const Pair excess = root * root * root + Pair{-x};
  return ToDouble(root + -(excess / (Pair{3} * root * root)));
}

}  // namespace isoscope::math
