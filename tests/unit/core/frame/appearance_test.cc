#include "core/frame/appearance.h"

#include <cmath>
#include <limits>

#include "gtest/gtest.h"

namespace isoscope::frame {
namespace {

TEST(AppearanceTest, TheRangeOfSamplesIsFiniteAndNotEmpty) {
  constexpr double kMost = std::numeric_limits<double>::max();
  EXPECT_EQ(ColorRangeOfSamples(-2, 3.5), (ColorRange{-2, 3.5}));
  EXPECT_EQ(ColorRangeOfSamples(7, 7), (ColorRange{7, std::nextafter(7.0, 8.0)}));
  for (const auto& [min, max] :
       {std::pair(-kMost, kMost), {kMost, kMost}, {-kMost, -kMost}, {0.0, kMost}}) {
    const ColorRange range = ColorRangeOfSamples(min, max);
    EXPECT_TRUE(range.max > range.min && std::isfinite(range.max - range.min))
        << min << ", " << max;
  }
}

TEST(AppearanceTest, OnlyOpacitiesBelowOneMakeAMapTranslucent) {
  EXPECT_FALSE(ColorBy().is_translucent());
  EXPECT_TRUE(ColorBy{.opacity_at_min = 0.5F}.is_translucent());
  EXPECT_TRUE(ColorBy{.opacity_at_max = 0}.is_translucent());
}

}  // namespace
}  // namespace isoscope::frame
