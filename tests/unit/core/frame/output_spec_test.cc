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
                              .normal = true}),
            33U);
}

}  // namespace
}  // namespace isoscope::frame
