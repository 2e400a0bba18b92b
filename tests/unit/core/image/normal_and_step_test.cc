#include "core/image/normal_and_step.h"

#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "gtest/gtest.h"

#include "core/base/random.h"

namespace isoscope::image {
namespace {

double AngleDegrees(const std::array<double, 3>& v, const std::array<float, 3>& unit) {
  const double length = std::hypot(v[0], v[1], v[2]);
  double chord_squared = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    chord_squared += std::pow(v[i] / length - static_cast<double>(unit[i]), 2);
  }
  return 2 * std::asin(std::sqrt(chord_squared) / 2) * 180 / std::numbers::pi;
}

TEST(NormalAndStepTest, EveryDirectionComesBackWithinATenthOfADegreeWithItsStep) {
  for (std::uint64_t i = 0; i < 100000; ++i) {
    const auto unit = [&](std::uint64_t k) { return 2 * base::RandomUnit(8, 3 * i + k) - 1; };
    const std::array<double, 3> v{unit(0), unit(1), unit(2)};
    const auto step = static_cast<std::uint8_t>(i);
    const Rgba8 code = EncodeNormalAndStep(EncodeNormal(v), step);
    ASSERT_EQ(StepOf(code), step);
    ASSERT_LT(AngleDegrees(v, DecodeNormal(NormalOf(code))), 0.1) << i;
  }
}

TEST(NormalAndStepTest, AxesComeBackAsTheyAre) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const double sign : {-1.0, 1.0}) {
      std::array<double, 3> v{};
      v[axis] = sign;
      EXPECT_EQ(NormalOf(EncodeNormalAndStep(EncodeNormal(v), 7)), EncodeNormal(v)) << axis;
    }
  }
}

TEST(NormalAndStepTest, NoNormalStaysNone) {
  EXPECT_EQ(NormalOf(EncodeNormalAndStep(kNoNormal, 9)), kNoNormal);
  EXPECT_EQ(StepOf(EncodeNormalAndStep(kNoNormal, 9)), 9);
}

TEST(NormalAndStepTest, ADirectionWithoutAStepComesBackWithinFourTenthsOfADegree) {
  for (std::uint64_t i = 0; i < 100000; ++i) {
    const auto unit = [&](std::uint64_t k) { return 2 * base::RandomUnit(9, 3 * i + k) - 1; };
    const std::array<double, 3> v{unit(0), unit(1), unit(2)};
    const Rgba8 code = EncodeNormalWithoutStep(EncodeNormal(v));
    ASSERT_FALSE(HasStep(code)) << i;
    ASSERT_LT(AngleDegrees(v, DecodeNormal(NormalOf(code))), 0.4) << i;
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const double sign : {-1.0, 1.0}) {
      std::array<double, 3> v{};
      v[axis] = sign;
      EXPECT_EQ(NormalOf(EncodeNormalWithoutStep(EncodeNormal(v))), EncodeNormal(v)) << axis;
    }
  }
  EXPECT_FALSE(HasStep(EncodeNormalWithoutStep(kNoNormal)));
  EXPECT_EQ(NormalOf(EncodeNormalWithoutStep(kNoNormal)), kNoNormal);
}

// The bytes of coordinates that EncodeNormal can give, and their ends.
TEST(NormalAndStepTest, NoVectorWithAStepLooksLikeOneWithout) {
  EXPECT_TRUE(HasStep(EncodeNormalAndStep(kNoNormal, 0)));
  for (int x = -32767; x <= 32767; x += 61) {
    for (const int y : {-32767, -32766, -16384, -1, 0, 1, 16383, 32767}) {
      const Rgba8 normal{static_cast<std::uint8_t>(x >> 8), static_cast<std::uint8_t>(x),
                         static_cast<std::uint8_t>(y >> 8), static_cast<std::uint8_t>(y)};
      for (const int step : {0, 128, 255}) {
        ASSERT_TRUE(HasStep(EncodeNormalAndStep(normal, static_cast<std::uint8_t>(step))))
            << x << ", " << y;
      }
    }
  }
}

TEST(NormalAndStepTest, AnyBitsAreAVectorOrNone) {
  for (std::uint32_t bits = 0; bits < 1U << 24; bits += 7) {
    const Rgba8 code{static_cast<std::uint8_t>(bits >> 16), static_cast<std::uint8_t>(bits >> 8),
                     static_cast<std::uint8_t>(bits), static_cast<std::uint8_t>(bits * 31 >> 3)};
    const Rgba8 normal = NormalOf(code);
    const std::array<float, 3> v = DecodeNormal(normal);
    ASSERT_EQ(normal == kNoNormal, v == (std::array<float, 3>{0, 0, 0})) << bits;
    ASSERT_TRUE(normal == kNoNormal || std::abs(std::hypot(v[0], v[1], v[2]) - 1) < 1e-5F) << bits;
  }
}

}  // namespace
}  // namespace isoscope::image
