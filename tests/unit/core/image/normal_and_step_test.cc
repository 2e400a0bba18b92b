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

TEST(NormalAndStepTest, AnyBitsAreAVectorOrNone) {
  for (std::uint32_t bits = 0; bits < 1U << 24; bits += 7) {
    const Rgba8 code{static_cast<std::uint8_t>(bits >> 16), static_cast<std::uint8_t>(bits >> 8),
                     static_cast<std::uint8_t>(bits), 0};
    const Rgba8 normal = NormalOf(code);
    const std::array<float, 3> v = DecodeNormal(normal);
    ASSERT_EQ(normal == kNoNormal, v == (std::array<float, 3>{0, 0, 0})) << bits;
    ASSERT_TRUE(normal == kNoNormal || std::abs(std::hypot(v[0], v[1], v[2]) - 1) < 1e-5F) << bits;
  }
}

}  // namespace
}  // namespace isoscope::image
