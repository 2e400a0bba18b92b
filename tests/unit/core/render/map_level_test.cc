#include "core/render/map_level.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

#include "gtest/gtest.h"

#include "core/image/normal_and_step.h"
#include "core/image/normal_code.h"

namespace isoscope::render {
namespace {

TEST(MapLevelTest, StepsCutTheRangeIntoEqualParts) {
  const MapScale scale({.min = 10, .max = 20});
  for (int step = 0; step < kMapSteps; ++step) {
    const double middle = 10 + 10 * (step + 0.5) / kMapSteps;
    EXPECT_EQ(MapStepOf(scale.MapLevelOf(middle)), step);
  }
  EXPECT_EQ(MapStepOf(scale.MapLevelOf(-5)), 0);
  EXPECT_EQ(MapStepOf(scale.MapLevelOf(20)), 255);
  EXPECT_EQ(MapStepOf(scale.MapLevelOf(1e30)), 255);
}

TEST(MapLevelTest, ATriangleWithAMissingCornerHasNoValueAndOneWithAnInfiniteCornerHasItsEnd) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const MapScale scale({.min = 10, .max = 20});
  const auto mixed = [&](double a, double b, double c) {
    return MapLevelsToMix({scale.MapLevelOf(a), scale.MapLevelOf(b), scale.MapLevelOf(c)});
  };
  // Finite levels stay, those far beyond the ends too.
  const std::array<float, 3> finite = mixed(12, -5, 1e20);
  EXPECT_EQ(finite, (std::array<float, 3>{scale.MapLevelOf(12), scale.MapLevelOf(-5),
                                          scale.MapLevelOf(1e20)}));
  for (int corner = 0; corner < 3; ++corner) {
    std::array<double, 3> values{12, 13, 14};
    const auto at = static_cast<std::size_t>(corner);
    const auto levels = [&] { return mixed(values[0], values[1], values[2]); };
    values[at] = kNan;
    for (const float level : levels()) {
      EXPECT_TRUE(std::isnan(level)) << corner;
    }
    // All corners alike: no weight shows, also not one of 0 or of rounding.
    values[at] = kInfinity;
    EXPECT_EQ(levels(), (std::array<float, 3>{1e30F, 1e30F, 1e30F})) << corner;
    values[(at + 1) % 3] = kInfinity;
    EXPECT_EQ(levels(), (std::array<float, 3>{1e30F, 1e30F, 1e30F})) << corner;
    values[at] = values[(at + 1) % 3] = -kInfinity;
    EXPECT_EQ(levels(), (std::array<float, 3>{-1e30F, -1e30F, -1e30F})) << corner;
    // Between infinities of both signs there is no value.
    values[at] = kInfinity;
    EXPECT_TRUE(std::isnan(levels()[0])) << corner;
    values[at] = kNan;
    EXPECT_TRUE(std::isnan(levels()[0])) << corner;
  }
}

TEST(MapLevelTest, TheCodeOfAMissingLevelHasTheNormalAndNoStep) {
  const image::Rgba8 normal = image::EncodeNormal({0, 1, 0});
  EXPECT_EQ(CodeOf(normal, 12.5F), image::EncodeNormalAndStep(normal, 12));
  EXPECT_EQ(CodeOf(normal, 1e30F), image::EncodeNormalAndStep(normal, 255));
  const image::Rgba8 missing = CodeOf(normal, std::numeric_limits<float>::quiet_NaN());
  EXPECT_FALSE(image::HasStep(missing));
  EXPECT_EQ(image::NormalOf(missing), normal);
}

TEST(MapLevelTest, LevelsOfNumbersAreFiniteForAnyRange) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  constexpr float kMost = std::numeric_limits<float>::max();
  for (const frame::ColorRange range :
       {frame::ColorRange{0, 5e-324}, {-1e-300, 0}, {0, 1.7e308}, {-8e307, 8e307}}) {
    for (const double value :
         {0.0, 1e-45, 1.0, static_cast<double>(kMost), -1e308, 1e308, kInfinity, -kInfinity}) {
      EXPECT_TRUE(std::isfinite(MapScale(range).MapLevelOf(value))) << range.max << ", " << value;
    }
    EXPECT_TRUE(std::isnan(MapScale(range).MapLevelOf(std::numeric_limits<double>::quiet_NaN())));
  }
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
