#include "core/picture/color_map.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "gtest/gtest.h"

namespace isoscope::picture {
namespace {

using frame::ColorMap;
using image::Rgba8;

constexpr ColorMap kMaps[] = {ColorMap::kViridis, ColorMap::kMagma,    ColorMap::kCividis,
                              ColorMap::kTurbo,   ColorMap::kCoolWarm, ColorMap::kGrey};

// Published colours of each map: both ends, and the middle (entries 0, 128 and 255).
TEST(ColorMapTest, EndsAndMiddleAreThePublishedOnes) {
  struct Case {
    ColorMap map;
    Rgba8 first;
    Rgba8 middle;
    Rgba8 last;
  };
  const Case cases[] = {
      {ColorMap::kViridis, {68, 1, 84, 255}, {33, 145, 140, 255}, {253, 231, 37, 255}},
      {ColorMap::kMagma, {0, 0, 4, 255}, {183, 55, 121, 255}, {252, 253, 191, 255}},
      {ColorMap::kCividis, {0, 34, 78, 255}, {125, 124, 120, 255}, {254, 232, 56, 255}},
      {ColorMap::kTurbo, {48, 18, 59, 255}, {164, 252, 60, 255}, {122, 4, 3, 255}},
      {ColorMap::kCoolWarm, {59, 76, 192, 255}, {221, 221, 221, 255}, {180, 4, 38, 255}},
      {ColorMap::kGrey, {0, 0, 0, 255}, {128, 128, 128, 255}, {255, 255, 255, 255}},
  };
  for (const Case& expected : cases) {
    SCOPED_TRACE(static_cast<int>(expected.map));
    const ColorMapTable& table = ColorMapTableOf(expected.map);
    EXPECT_EQ(table.front(), expected.first);
    EXPECT_EQ(table.back(), expected.last);
    EXPECT_NEAR(table[128].r, expected.middle.r, 2);
    EXPECT_NEAR(table[128].g, expected.middle.g, 2);
    EXPECT_NEAR(table[128].b, expected.middle.b, 2);
  }
}

TEST(ColorMapTest, NeighboursDifferByAFewLevelsAndAllAreOpaque) {
  for (const ColorMap map : kMaps) {
    const ColorMapTable& table = ColorMapTableOf(map);
    for (std::size_t i = 0; i < table.size(); ++i) {
      EXPECT_EQ(table[i].a, 255);
      if (i > 0) {
        const int difference =
            std::max({std::abs(table[i].r - table[i - 1].r), std::abs(table[i].g - table[i - 1].g),
                      std::abs(table[i].b - table[i - 1].b)});
        EXPECT_LE(difference, 8) << "map " << static_cast<int>(map) << ", step " << i;
      }
    }
  }
}

TEST(ColorMapTest, StepsCutTheRangeIntoEqualParts) {
  const frame::ColorRange range{-2, 6};
  EXPECT_EQ(ColorMapStepOf(-2, range), 0U);
  EXPECT_EQ(ColorMapStepOf(-2 + 8.0 / 256, range), 1U);
  EXPECT_EQ(ColorMapStepOf(2, range), 128U);
  EXPECT_EQ(ColorMapStepOf(5.99, range), 255U);
  EXPECT_EQ(ColorMapStepOf(6, range), 255U);
  EXPECT_EQ(ColorMapStepOf(-3, range), 0U);
  EXPECT_EQ(ColorMapStepOf(1e300, range), 255U);
  EXPECT_EQ(ColorMapStepOf(-std::numeric_limits<double>::infinity(), range), 0U);
}

TEST(ColorMapTest, WithoutARangeItIsTheVolumesBox) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {11, 21, 31};
  geometry.spacing = {1, 0.5, 2};
  geometry.origin = {-3, 10, 100};
  frame::ColorBy color_by{.quantity = frame::ColorBy::Quantity::kPositionY};
  EXPECT_EQ(ColorRangeOf(color_by, geometry), (frame::ColorRange{10, 20}));
  color_by.quantity = frame::ColorBy::Quantity::kPositionZ;
  EXPECT_EQ(ColorRangeOf(color_by, geometry), (frame::ColorRange{100, 160}));
  color_by.range = frame::ColorRange{0, 1};
  EXPECT_EQ(ColorRangeOf(color_by, geometry), (frame::ColorRange{0, 1}));
  color_by.quantity = frame::ColorBy::Quantity::kField;
  EXPECT_EQ(ColorRangeOf(color_by, geometry), (frame::ColorRange{0, 1}));
}

TEST(ColorMapTest, OpacityIsLinearFromTheFirstStepToTheLastAndExactAtBoth) {
  frame::ColorBy color_by{.opacity_at_min = 0.1F, .opacity_at_max = 0.7F};
  EXPECT_EQ(OpacityOf(color_by, 0), 0.1F);
  EXPECT_EQ(OpacityOf(color_by, kColorMapSteps - 1), 0.7F);
  EXPECT_NEAR(OpacityOf(color_by, 85), 0.3F, 1e-6F);
  color_by = {};
  for (std::size_t step = 0; step < kColorMapSteps; ++step) {
    ASSERT_EQ(OpacityOf(color_by, step), 1.0F) << step;
  }
}

}  // namespace
}  // namespace isoscope::picture
