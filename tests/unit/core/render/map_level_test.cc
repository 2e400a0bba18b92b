#include "core/render/map_level.h"

#include <cmath>
#include <limits>

#include "gtest/gtest.h"

namespace isoscope::render {
namespace {

TEST(MapLevelTest, StepsCutTheRangeIntoEqualParts) {
  const MapScale scale({.min = 10, .max = 20});
  for (int step = 0; step < kMapSteps; ++step) {
    const float middle = 10 + 10 * (static_cast<float>(step) + 0.5F) / kMapSteps;
    EXPECT_EQ(MapStepOf(scale.LevelOf(middle)), step);
  }
  EXPECT_EQ(MapStepOf(scale.LevelOf(-5)), 0);
  EXPECT_EQ(MapStepOf(scale.LevelOf(20)), 255);
  EXPECT_EQ(MapStepOf(scale.LevelOf(1e30F)), 255);
}

TEST(MapLevelTest, LevelsAreFiniteForAnyRange) {
  constexpr float kMost = std::numeric_limits<float>::max();
  for (const frame::ColorRange range :
       {frame::ColorRange{0, 5e-324}, {-1e-300, 0}, {0, 1.7e308}, {-8e307, 8e307}}) {
    for (const float magnitude : {0.0F, 1e-45F, 1.0F, kMost}) {
      EXPECT_TRUE(std::isfinite(MapScale(range).LevelOf(magnitude))) << range.max;
    }
  }
  EXPECT_EQ(MapStepOf(std::numeric_limits<float>::quiet_NaN()), 0);
}

TEST(MapLevelTest, OnlySurfacesThatShowTheGradientHaveAScaleAndOnlyIfStepsAreSent) {
  frame::FrameSpec spec;
  spec.surfaces.resize(2);
  spec.surfaces[1].color_by = frame::ColorBy{
      .quantity = frame::ColorBy::Quantity::kGradientMagnitude, .range = frame::ColorRange{0, 1}};
  EXPECT_FALSE(MapScalesOf(spec)[1].has_value());
  spec.sends_map_steps = true;
  EXPECT_FALSE(MapScalesOf(spec)[0].has_value());
  EXPECT_TRUE(MapScalesOf(spec)[1].has_value());
}

}  // namespace
}  // namespace isoscope::render
