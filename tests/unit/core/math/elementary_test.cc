// Each function is tested in three ways:
//
// - a hash of the bits of many results, equal on every machine;
// - the error in units of the last place, against long double;
// - values that must be exact, symmetries, and the limits of the arguments.

#include "core/math/elementary.h"

#include <bit>
#include <cfloat>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <numbers>

#include "gtest/gtest.h"

#include "core/base/random.h"
#include "tests/support/skips.h"

namespace isoscope::math {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr std::uint64_t kCount = 300000;

// Angles of half a camera's opening, of turns, and near 0 on a logarithmic scale.
double Angle(std::uint64_t i) {
  const double unit = base::RandomUnit(1, i);
  switch (i % 3) {
    case 0:
      return unit * kPi / 2;
    case 1:
      return (unit - 0.5) * 2000;
    default:
      return std::ldexp(unit, -static_cast<int>(base::RandomBits(2, i) % 60));
  }
}
// Bases in (0, 1] for the exponents of highlights, and others.
double Base(std::uint64_t i) {
  const double unit = base::RandomUnit(3, i);
  return i % 2 == 0
             ? static_cast<double>(1 + i % 4096) / 4096
             : std::ldexp(unit + 0x1p-60, static_cast<int>(base::RandomBits(4, i) % 41) - 20);
}
double Exponent(std::uint64_t i) {
  const double unit = base::RandomUnit(5, i);
  return i % 2 == 0 ? 1 + 999 * unit : 20 * (unit - 0.5);
}
double Cube(std::uint64_t i) {
  return i % 2 == 0 ? static_cast<double>(i) : std::ldexp(base::RandomUnit(6, i), 40);
}

// A hash of the bits of fn(0), fn(1), ...: FNV-1a of 64-bit words.
std::uint64_t BitsOf(const std::function<double(std::uint64_t)>& fn) {
  std::uint64_t hash = 0xcbf29ce484222325;
  for (std::uint64_t i = 0; i < kCount; ++i) {
    hash = (hash ^ std::bit_cast<std::uint64_t>(fn(i))) * 0x100000001b3;
  }
  return hash;
}

// The largest distance of fn(i) from `exact(i)`, in units of the last place.
double WorstError(const std::function<double(std::uint64_t)>& fn,
                  const std::function<long double(std::uint64_t)>& exact) {
  long double worst = 0;
  for (std::uint64_t i = 0; i < kCount / 3; ++i) {
    const long double expected = exact(i);
    const double value = fn(i);
    if (std::abs(expected) < 0x1p-1000L || std::abs(expected) > 0x1p1000L) {
      continue;
    }
    const double magnitude = std::abs(value);
    const double unit = std::nextafter(magnitude, kInfinity) - magnitude;
    const long double error =
        std::abs(static_cast<long double>(value) - expected) / static_cast<long double>(unit);
    worst = std::max(worst, error);
  }
  return static_cast<double>(worst);
}

// Pictures are the same everywhere only if these functions return the same bits. A machine,
// compiler or option that changes one of a few hundred thousand results fails here.
TEST(ElementaryTest, BitsAreTheSameOnEveryMachine) {
  EXPECT_EQ(BitsOf([](std::uint64_t i) { return Angle(i); }), 0x62302c7266e60e16)
      << "the arguments";
  EXPECT_EQ(BitsOf([](std::uint64_t i) { return Sin(Angle(i)); }), 0xc07fcfecae785dc4);
  EXPECT_EQ(BitsOf([](std::uint64_t i) { return Cos(Angle(i)); }), 0x2e3f3dc4a0367aa5);
  EXPECT_EQ(BitsOf([](std::uint64_t i) { return Tan(Angle(i)); }), 0xa8c796429a674dea);
  EXPECT_EQ(BitsOf([](std::uint64_t i) { return Pow(Base(i), Exponent(i)); }), 0x68cc481e9c56fd9d);
  EXPECT_EQ(BitsOf([](std::uint64_t i) { return Cbrt(Cube(i)); }), 0x8d773ed1d71db1f9);
}

// long double has 11 bits more than double on x86-64, so that it can tell 0.501 from 0.5. (With 113
// bits, of one million results each, tangents, sines and cube roots were all rounded correctly, and
// 2 powers were not, at 0.500001.)
#if LDBL_MANT_DIG >= 64
TEST(ElementaryTest, ErrorsAreHardlyMoreThanThatOfRounding) {
  constexpr double kOfReference = 0x1p-10;
  EXPECT_LE(
      WorstError([](std::uint64_t i) { return Sin(Angle(i)); },
                 [](std::uint64_t i) { return std::sin(static_cast<long double>(Angle(i))); }),
      0.5 + kOfReference);
  EXPECT_LE(
      WorstError([](std::uint64_t i) { return Cos(Angle(i)); },
                 [](std::uint64_t i) { return std::cos(static_cast<long double>(Angle(i))); }),
      0.5 + kOfReference);
  EXPECT_LE(
      WorstError([](std::uint64_t i) { return Tan(Angle(i)); },
                 [](std::uint64_t i) { return std::tan(static_cast<long double>(Angle(i))); }),
      0.5 + kOfReference);
  EXPECT_LE(
      WorstError([](std::uint64_t i) { return Cbrt(Cube(i)); },
                 [](std::uint64_t i) { return std::cbrt(static_cast<long double>(Cube(i))); }),
      0.5 + kOfReference);
  EXPECT_LE(WorstError([](std::uint64_t i) { return Pow(Base(i), Exponent(i)); },
                       [](std::uint64_t i) {
                         return std::pow(static_cast<long double>(Base(i)),
                                         static_cast<long double>(Exponent(i)));
                       }),
            0.5 + kOfReference);
}
#endif

TEST(ElementaryTest, ValuesThatADoubleHoldsAreExact) {
  EXPECT_EQ(Sin(0.0), 0.0);
  EXPECT_TRUE(std::signbit(Sin(-0.0)));
  EXPECT_EQ(Tan(0.0), 0.0);
  EXPECT_TRUE(std::signbit(Tan(-0.0)));
  EXPECT_EQ(Cos(0.0), 1.0);
  EXPECT_EQ(Sin(kPi / 2), 1.0);
  EXPECT_EQ(Tan(kPi / 4), 0x1.fffffffffffffp-1);  // pi / 4 rounded down
  for (const double y : {-3.5, 0.0, 1.0, 1000.0}) {
    EXPECT_EQ(Pow(1, y), 1.0) << y;
  }
  for (int n = -40; n <= 40; ++n) {
    EXPECT_EQ(Pow(2, n), std::ldexp(1.0, n)) << n;
    EXPECT_EQ(Pow(0.5, n), std::ldexp(1.0, -n)) << n;
  }
  for (std::uint64_t i = 0; i < 10000; ++i) {
    const double x = Base(i);
    EXPECT_EQ(Pow(x, 1), x);
    EXPECT_EQ(Pow(x, 0), 1.0);
    EXPECT_EQ(Pow(x, 0.5), std::sqrt(x));
    EXPECT_EQ(Pow(x, 2), x * x);
    const auto root = static_cast<double>(i);
    EXPECT_EQ(Cbrt(root * root * root), root);
  }
}

TEST(ElementaryTest, LimitsAreThoseOfTheFunctions) {
  EXPECT_EQ(Pow(0, 0), 1.0);
  EXPECT_EQ(Pow(0, 2.5), 0.0);
  EXPECT_EQ(Pow(0, -1), kInfinity);
  EXPECT_EQ(Pow(0.5, 1e6), 0.0);
  EXPECT_EQ(Pow(0.5, 1e300), 0.0);
  EXPECT_EQ(Pow(0.5, 1074), 0x1p-1074);
  EXPECT_EQ(Pow(2, 1023), 0x1p1023);
  EXPECT_EQ(Pow(2, 1024), kInfinity);
  EXPECT_EQ(Pow(2, 1e300), kInfinity);
  EXPECT_EQ(Pow(0x1p-1074, 1), 0x1p-1074);
  EXPECT_TRUE(std::isnan(Pow(-1, 2)));
  EXPECT_EQ(Cbrt(0), 0.0);
  EXPECT_TRUE(std::isnan(Cbrt(-1)));
  for (const double x : {kInfinity, -kInfinity, std::numeric_limits<double>::quiet_NaN()}) {
    EXPECT_TRUE(std::isnan(Sin(x)));
    EXPECT_TRUE(std::isnan(Cos(x)));
    EXPECT_TRUE(std::isnan(Tan(x)));
  }
  for (const double x : {0x1p-1074, 0x1p-1030, 0x1p-500, 0x1p-60}) {
    EXPECT_EQ(Sin(x), x);
    EXPECT_EQ(Tan(x), x);
    EXPECT_EQ(Cos(x), 1.0);
  }
  for (const double x : {0x1p41, 1e100, 1.7e308}) {
    EXPECT_LE(std::abs(Sin(x)), 1.0) << "an angle that has no digit behind the point";
    EXPECT_NEAR(Sin(x) * Sin(x) + Cos(x) * Cos(x), 1, 1e-15);
  }
}

TEST(ElementaryTest, SinAndTanAreOddAndCosIsEven) {
  for (std::uint64_t i = 0; i < kCount / 10; ++i) {
    const double x = Angle(i);
    ASSERT_EQ(Sin(-x), -Sin(x)) << x;
    ASSERT_EQ(Tan(-x), -Tan(x)) << x;
    ASSERT_EQ(Cos(-x), Cos(x)) << x;
  }
}

#if defined(__x86_64__)
// Contraction into fused multiply-add would change bits where the processor has it. This function
// may use it, and must not.
__attribute__((target("fma"), noinline)) double ProductLess(double a, double b, double c) {
  return a * b - c;
}
TEST(ElementaryTest, TheCompilerDoesNotFuseMultiplicationAndAddition) {
  if (!__builtin_cpu_supports("fma")) {
    ISOSCOPE_SKIP("fma", "this processor has no fused multiply-add");
  }
  const volatile double a = 1 + 0x1p-27;  // volatile: the compiler must not compute it itself
  const volatile double c = 1 + 0x1p-26;
  EXPECT_EQ(ProductLess(a, a, c), 0.0) << "2^-54 if fused";
}
#endif

}  // namespace
}  // namespace isoscope::math
