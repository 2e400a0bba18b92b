#include "core/image/frame_image.h"

#include "gtest/gtest.h"

namespace isoscope::image {
namespace {

TEST(FragmentKeyTest, NearerWinsThenTheLowerBlockThenAnythingOverBackground) {
  EXPECT_LT(FragmentKey(0.25F, 9), FragmentKey(0.5F, 1));
  EXPECT_LT(FragmentKey(0.5F, 1), FragmentKey(0.5F, 2));
  EXPECT_LT(FragmentKey(0.0F, 0), FragmentKey(1e-45F, 0));
  EXPECT_LT(FragmentKey(1.0F, kNoBlock - 1), FragmentKey(kFarDepth, kNoBlock));
}

TEST(FragmentKeyTest, NegativeZeroIsZero) {
  EXPECT_EQ(FragmentKey(-0.0F, 3), FragmentKey(0.0F, 3));
}

TEST(FrameImageTest, StartsAsBackground) {
  const FrameImage image(3, 2);
  EXPECT_EQ(image.pixel_count(), 6u);
  for (std::size_t i = 0; i < image.pixel_count(); ++i) {
    EXPECT_EQ(image.depth[i], kFarDepth);
    EXPECT_EQ(image.block_id[i], kNoBlock);
    EXPECT_EQ(image.color[i], Rgba8{});
  }
}

}  // namespace
}  // namespace isoscope::image
