#include "core/render/map_level.h"

#include <cmath>
#include <limits>

#include "gtest/gtest.h"

namespace isoscope::render {
namespace {

TEST(MapLevelTest, StepsCutTheRangeIntoEqualParts) {
  const MapScale scale({.min = 10, .max = 20});
  for (int step = 0; step < kMapSteps; ++step) {
    const double middle = 10 + 10 * (step + 0.5) / kMapSteps;
    EXPECT_EQ(MapStepOf(scale.LevelOf(middle)), step);
  }
  EXPECT_EQ(MapStepOf(scale.LevelOf(-5)), 0);
  EXPECT_EQ(MapStepOf(scale.LevelOf(20)), 255);
  EXPECT_EQ(MapStepOf(scale.LevelOf(1e30)), 255);
  // A triangle shows the end, wherever NaN or the infinity is.
  const double infinity = std::numeric_limits<double>::infinity();
  const float nan_level = scale.LevelOf(std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(MapStepOf(0.01F * nan_level + 0.99F * scale.LevelOf(10)), 255);
  EXPECT_EQ(nan_level, scale.LevelOf(infinity));
  EXPECT_EQ(MapStepOf(0.01F * scale.LevelOf(-infinity) + 0.99F * scale.LevelOf(20)), 0);
}

TEST(MapLevelTest, LevelsAreFiniteForAnyRange) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  constexpr float kMost = std::numeric_limits<float>::max();
  for (const frame::ColorRange range :
       {frame::ColorRange{0, 5e-324}, {-1e-300, 0}, {0, 1.7e308}, {-8e307, 8e307}}) {
    for (const double value : {0.0, 1e-45, 1.0, static_cast<double>(kMost), -1e308, 1e308,
                               kInfinity, -kInfinity, std::numeric_limits<double>::quiet_NaN()}) {
      EXPECT_TRUE(std::isfinite(MapScale(range).LevelOf(value))) << range.max << ", " << value;
    }
  }
  EXPECT_EQ(MapStepOf(std::numeric_limits<float>::quiet_NaN()), 0);
}

TEST(MapLevelTest, OnlySurfacesThatShowValuesHaveAScaleAndOnlyIfStepsAreSent) {
  frame::FrameSpec spec;
  spec.surfaces.resize(3);
  spec.surfaces[2].color_by = frame::ColorBy{.quantity = frame::ColorBy::Quantity::kField,
                                             .range = frame::ColorRange{0, 1},
                                             .field = "pressure"};
  spec.surfaces[1].color_by = frame::ColorBy{
      .quantity = frame::ColorBy::Quantity::kGradientMagnitude, .range = frame::ColorRange{0, 1}};
  EXPECT_FALSE(MapScalesOf(spec)[1].has_value());
  spec.sends_map_steps = true;
  EXPECT_FALSE(MapScalesOf(spec)[0].has_value());
  EXPECT_TRUE(MapScalesOf(spec)[1].has_value());
  EXPECT_TRUE(MapScalesOf(spec)[2].has_value());
}

}  // namespace
}  // namespace isoscope::render
