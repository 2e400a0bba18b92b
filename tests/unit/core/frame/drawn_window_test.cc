#include "core/frame/drawn_window.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::frame {
namespace {

using isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

FrameSpec SpecOf(const view::Viewport& viewport, const std::optional<view::Region>& region,
                 int samples_per_side) {
  FrameSpec spec;
  spec.viewport = viewport;
  spec.region = region;
  spec.effects.samples_per_side = samples_per_side;
  return spec;
}

TEST(DrawnWindowTest, AFrameWithoutEffectsIsDrawnAsItIs) {
  const FrameSpec whole = SpecOf({300, 200}, std::nullopt, 1);
  EXPECT_TRUE(DrawnWindowOf(whole).is_picture_of(whole));
  EXPECT_FALSE(DrawnWindowOf(whole).region.has_value());
  const FrameSpec part = SpecOf({300, 200}, view::Region{7, 8, 90, 20}, 1);
  EXPECT_TRUE(DrawnWindowOf(part).is_picture_of(part));
  EXPECT_EQ(DrawnWindowOf(part).region, part.region);
}

TEST(DrawnWindowTest, SamplesScaleViewportAndRegion) {
  const FrameSpec spec = SpecOf({300, 200}, view::Region{7, 8, 90, 20}, 3);
  EXPECT_EQ(DrawnWindowOf(spec),
            (DrawnWindow{.viewport = {900, 600}, .region = view::Region{21, 24, 270, 60}}));
  EXPECT_FALSE(DrawnWindowOf(spec).is_picture_of(spec));
}

TEST(DrawnWindowTest, AMarginEndsAtTheBorderOfTheWhole) {
  FrameSpec spec = SpecOf({300, 200}, view::Region{7, 100, 90, 95}, 2);
  spec.effects.silhouette = {.width_px = 8, .color = {}};
  EXPECT_EQ(spec.effects.margin_px(), 10);
  EXPECT_EQ(DrawnWindowOf(spec), (DrawnWindow{.viewport = {600, 400},
                                              .region = view::Region{0, 180, 2 * 107, 2 * 110},
                                              .begin_x = 14,
                                              .begin_y = 20}));
  // The whole viewport has no margin.
  spec.region.reset();
  spec.effects.samples_per_side = 1;
  EXPECT_TRUE(DrawnWindowOf(spec).is_picture_of(spec));
}

TEST(DrawnWindowTest, WhatNobodyCanDrawIsRefusedWithItsNumbers) {
  const auto with_mask = [](FrameSpec spec) {
    spec.culling = Culling::kMask;
    return spec;
  };
  ISOSCOPE_EXPECT_OK(CheckDrawnWindow(with_mask(SpecOf({4096, 4096}, std::nullopt, 4))));
  EXPECT_THAT(CheckDrawnWindow(with_mask(SpecOf({4097, 100}, std::nullopt, 4))),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("samples is 16"), HasSubstr("viewport of 4097 x 100"),
                             HasSubstr("16384"))));
  ISOSCOPE_EXPECT_OK(CheckDrawnWindow(SpecOf({16384, 100}, view::Region{0, 0, 4096, 9}, 4)));
  EXPECT_THAT(CheckDrawnWindow(SpecOf({16385, 100}, view::Region{0, 0, 1, 1}, 4)),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("viewport of 16385 x 100"), HasSubstr("65536"))));
  FrameSpec spec = SpecOf({65536, 100}, view::Region{100, 0, 16384, 9}, 1);
  ISOSCOPE_EXPECT_OK(CheckDrawnWindow(spec));
  spec.effects.silhouette.emplace();
  EXPECT_THAT(CheckDrawnWindow(with_mask(spec)),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("region of 16384 x 9"), HasSubstr("margin of 4"))));
}

TEST(DrawnWindowTest, WhatOneViewCannotDrawIsLeftToBandsUnlessTheMaskCulls) {
  FrameSpec spec = SpecOf({16384, 16384}, std::nullopt, 4);
  ISOSCOPE_EXPECT_OK(CheckDrawnWindow(spec));
  EXPECT_FALSE(DrawnWindowOf(spec).fits_a_view());
  spec.culling = Culling::kNone;
  ISOSCOPE_EXPECT_OK(CheckDrawnWindow(spec));
  EXPECT_TRUE(DrawnWindowOf(SpecOf({16384, 9}, std::nullopt, 1)).fits_a_view());
  EXPECT_FALSE(DrawnWindowOf(SpecOf({9, 4097}, std::nullopt, 4)).fits_a_view());
}

}  // namespace
}  // namespace isoscope::frame
