#include "core/image/srgb.h"

#include <cmath>
#include <cstdint>
#include <limits>

#include "gtest/gtest.h"

namespace isoscope::image {
namespace {

float LinearOf(std::uint8_t srgb) { return SrgbTable::Get().LinearOf(srgb); }
std::uint8_t SrgbOf(float linear) { return SrgbTable::Get().SrgbOf(linear); }

TEST(SrgbTest, KnownValues) {
  EXPECT_EQ(LinearOf(0), 0.0F);
  EXPECT_EQ(LinearOf(255), 1.0F);
  EXPECT_NEAR(LinearOf(188), 0.5029F, 1e-4F);
  EXPECT_NEAR(LinearOf(10), 10 / 255.0 / 12.92, 1e-7);  // on the straight part
  // Half of the light of white.
  EXPECT_EQ(SrgbOf(0.5F), 188);
}

TEST(SrgbTest, EveryValueComesBack) {
  for (int value = 0; value < 256; ++value) {
    EXPECT_EQ(SrgbOf(LinearOf(static_cast<std::uint8_t>(value))), value);
  }
}

TEST(SrgbTest, TheNearestValueIsTheOneThatTheFormulaRoundsTo) {
  for (int i = 0; i <= 100000; ++i) {
    const double linear = i / 100000.0;
    const double srgb =
        255 * (linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055);
    // At the borders between two values, rounding decides.
    if (std::abs(srgb - std::floor(srgb) - 0.5) > 1e-3) {
      ASSERT_EQ(SrgbOf(static_cast<float>(linear)), std::lround(srgb)) << linear;
    }
  }
}

TEST(SrgbTest, LightThatIsNoneOrTooMuchIsClamped) {
  EXPECT_EQ(SrgbOf(-1), 0);
  EXPECT_EQ(SrgbOf(2), 255);
  EXPECT_EQ(SrgbOf(std::numeric_limits<float>::infinity()), 255);
  EXPECT_EQ(SrgbOf(std::numeric_limits<float>::quiet_NaN()), 0);
}

}  // namespace
}  // namespace isoscope::image
