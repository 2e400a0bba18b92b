#include "client-cli/commands/small_frame.h"

#include "gtest/gtest.h"

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;

TEST(SmallFrameTest, TheWholeIsSmallAndKeepsItsShape) {
  v1::RenderIsosurfaceRequest frame;
  frame.set_isovalue(60);
  frame.set_samples(16);
  frame.mutable_viewport()->set_width_px(32768);
  frame.mutable_viewport()->set_height_px(8192);
  frame.mutable_region()->set_width_px(100);
  frame.mutable_output()->set_depth(true);
  const v1::RenderIsosurfaceRequest small = SmallFrameOf(frame, 1024);
  EXPECT_EQ(small.viewport().width_px(), 1024);
  EXPECT_EQ(small.viewport().height_px(), 256);
  EXPECT_EQ(small.isovalue(), 60);
  EXPECT_EQ(small.samples(), 0);
  EXPECT_FALSE(small.has_region());
  EXPECT_FALSE(small.has_output());
}

TEST(SmallFrameTest, ASmallOneStaysAndNoSideVanishes) {
  v1::RenderIsosurfaceRequest frame;
  frame.mutable_viewport()->set_width_px(640);
  frame.mutable_viewport()->set_height_px(480);
  EXPECT_EQ(SmallFrameOf(frame, 1024).viewport().width_px(), 640);
  frame.mutable_viewport()->set_width_px(65536);
  frame.mutable_viewport()->set_height_px(1);
  EXPECT_EQ(SmallFrameOf(frame, 1024).viewport().height_px(), 1);
}

}  // namespace
}  // namespace isoscope::cli
