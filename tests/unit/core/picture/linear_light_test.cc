#include "core/picture/linear_light.h"

#include <cmath>

#include "gtest/gtest.h"

namespace isoscope::picture {
namespace {

TEST(LinearLightTest, IsTheStandardsFormula) {
  const LinearLightTables& tables = LinearLight();
  for (std::size_t value = 0; value < 256; ++value) {
    const double srgb = static_cast<double>(value) / 255;
    const double light = srgb <= 0.04045 ? srgb / 12.92 : std::pow((srgb + 0.055) / 1.055, 2.4);
    EXPECT_NEAR(tables.light[value], 65535 * light, 0.5001) << value;
  }
  EXPECT_EQ(tables.light[0], 0);
  EXPECT_EQ(tables.light[1], 20);
  EXPECT_EQ(tables.light[128], 14146);
  EXPECT_EQ(tables.light[255], 65535);
}

TEST(LinearLightTest, ThereAndBackIsTheSame) {
  const LinearLightTables& tables = LinearLight();
  for (std::size_t value = 0; value < 256; ++value) {
    EXPECT_EQ(tables.srgb[tables.light[value]], value);
  }
}

TEST(LinearLightTest, ALightGetsItsNearestValue) {
  const LinearLightTables& tables = LinearLight();
  for (std::size_t light = 0; light <= kFullLight; ++light) {
    const double linear = static_cast<double>(light) / 65535;
    const double srgb =
        linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
    ASSERT_NEAR(tables.srgb[light], 255 * srgb, 0.501) << light;
  }
  EXPECT_EQ(tables.srgb[32768], 188);
}

}  // namespace
}  // namespace isoscope::picture
