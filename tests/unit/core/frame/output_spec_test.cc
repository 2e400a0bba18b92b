#include "core/frame/output_spec.h"

#include "gtest/gtest.h"

namespace isoscope::frame {
namespace {

TEST(OutputSpecTest, OnlyWhatIsSentWithoutCompressionCountsByPixel) {
  EXPECT_EQ(RawBytesPerPixel({}), 0U);
  EXPECT_EQ(RawBytesPerPixel({.image_format = ImageFormat::kJpeg}), 0U);
  EXPECT_EQ(RawBytesPerPixel({.image_format = ImageFormat::kRgba8}), 4U);
  EXPECT_EQ(RawBytesPerPixel({.depth = true}), 4U);
  EXPECT_EQ(RawBytesPerPixel({.image_format = ImageFormat::kNone, .surface_index = true}), 1U);
  EXPECT_EQ(RawBytesPerPixel({.image_format = ImageFormat::kRgba8,
                              .depth = true,
                              .surface_index = true,
                              .position = true,
                              .normal = true,
                              .depth_bounds = true}),
            41U);
}

TEST(OutputSpecTest, BoundsAloneNeedNoDrawing) {
  EXPECT_TRUE(OutputSpec{}.is_drawn());
  EXPECT_FALSE(OutputSpec{}.any_plane());
  const OutputSpec bounds{.image_format = ImageFormat::kNone, .depth_bounds = true};
  EXPECT_FALSE(bounds.is_drawn());
  EXPECT_TRUE(bounds.any_plane());
  EXPECT_FALSE(bounds.any_drawn_plane());
  EXPECT_TRUE((OutputSpec{.image_format = ImageFormat::kNone, .depth = true}).is_drawn());
}

}  // namespace
}  // namespace isoscope::frame
