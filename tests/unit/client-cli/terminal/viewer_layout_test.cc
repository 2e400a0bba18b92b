#include "client-cli/terminal/viewer_layout.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/image/jpeg_codec.h"
#include "core/image/png_codec.h"
#include "tests/support/status_matchers.h"
#include "tests/support/terminal_screen.h"

namespace isoscope::cli {
namespace {

using ::testing::HasSubstr;

constexpr TerminalSize kTerminal{80, 25, {800, 500}};

TEST(StatusTextTest, ALongSentenceEndsWithAnEllipsisBesideTheKeys) {
  const std::string sentence =
      "isovalue 300 has no surface: all samples of the dataset are in [0, 255], and 255 is noise";
  const std::string line = StatusText("head   isovalue 300", sentence, "640 x 480 exact", 80);
  EXPECT_EQ(line.size(), 80);
  EXPECT_EQ(line.substr(60), "...  ? help  q quit ");
  EXPECT_EQ(line.substr(1, 59), sentence.substr(0, 59)) << "it stands without the view";
}

TEST(StatusTextTest, WhatFitsIsWhole) {
  EXPECT_EQ(StatusText("head   isovalue 60", "", "640 x 480 exact   12 ms", 80),
            " head   isovalue 60   640 x 480 exact   12 ms                    ? help  q quit ");
  EXPECT_EQ(StatusText("head", "a note", "640 x 480", 20), " head   a note      ");
  EXPECT_EQ(StatusText("head", "", "", 6), " head ");
}

TEST(StatusTextTest, TheTimeOfAFrameGivesWayToItsSize) {
  EXPECT_EQ(StatusText("head   isovalue 60", "", "320 x 176 exact   12 ms", 40),
            " head   isovalue 60   320 x 176 exact   ");
}

TEST(StatusTextTest, NarrowWindowsAndOtherAlphabetsKeepToTheWidth) {
  EXPECT_EQ(StatusText("head", "", "640 x 480", 10), " head  ...");
  EXPECT_EQ(StatusText("head", "", "", 2), "..");
  EXPECT_EQ(StatusText("head", "", "", 0), "");
  EXPECT_EQ(StatusText("\xc3\xa4\xc3\xb6\xc3\xbc", "", "\xc3\xa4", 10),
            " \xc3\xa4\xc3\xb6\xc3\xbc   \xc3\xa4  ");
  EXPECT_EQ(StatusText("\xc3\xa4\xc3\xb6\xc3\xbc\xc3\xa4\xc3\xb6", "", "", 5), " \xc3\xa4...");
  EXPECT_EQ(StatusText("a\x1B[2J", "", "", 7), " a?[2J ");
}

image::RgbaImage Gray(int width, int height) {
  return {
      .width = width,
      .height = height,
      .pixels = std::vector<image::Rgba8>(
          static_cast<std::size_t>(width) * static_cast<std::size_t>(height), {95, 95, 95, 255})};
}

isoscope::v1::InteractResponse Exact(const image::RgbaImage& picture) {
  isoscope::v1::InteractResponse response;
  response.set_is_exact(true);
  response.mutable_frame()->set_png(
      image::EncodePng(picture.width, picture.height, picture.pixels));
  return response;
}

isoscope::v1::InteractResponse Moving(const image::RgbaImage& picture) {
  isoscope::v1::InteractResponse response;
  response.mutable_frame()->set_jpeg(
      image::EncodeJpeg(picture.width, picture.height, picture.pixels, {}, 90).value());
  return response;
}

TEST(LayoutOfTest, LeavesTheLastRowFree) {
  const ViewerLayout layout = LayoutOf(PictureFormat::kKitty, kTerminal);
  EXPECT_EQ(layout.viewport, (view::Viewport{800, 480}));
  EXPECT_EQ(layout.box.columns, 80);
  EXPECT_EQ(layout.box.rows, 24);
}

TEST(LayoutOfTest, LargeWindowsAndBlocksKeepTheirShape) {
  const ViewerLayout large = LayoutOf(PictureFormat::kKitty, {400, 101, {4000, 2020}});
  EXPECT_EQ(large.viewport, (view::Viewport{1600, 800}));
  const ViewerLayout blocks = LayoutOf(PictureFormat::kBlocks256, {80, 25, {}});
  EXPECT_EQ(blocks.viewport, (view::Viewport{320, 192}));
  const ViewerLayout tiny = LayoutOf(PictureFormat::kSixel, {1, 1, {}});
  EXPECT_GE(tiny.viewport.width_px, 1);
  EXPECT_GE(tiny.viewport.height_px, 1);
}

TEST(DrawFrameTest, KittyAndITerm2GetTheBytesOfTheExactFrame) {
  const isoscope::v1::InteractResponse exact = Exact(Gray(800, 480));
  for (const PictureFormat format : {PictureFormat::kKitty, PictureFormat::kITerm2}) {
    const absl::StatusOr<std::string> bytes = DrawFrame(LayoutOf(format, kTerminal), exact, 1);
    ISOSCOPE_ASSERT_OK(bytes);
    EXPECT_EQ(testing::ReadTerminalBytes(*bytes).pictures.at(0).file, exact.frame().png());
  }
}

TEST(DrawFrameTest, SmallMovingFramesFillTheSamePlace) {
  const isoscope::v1::InteractResponse moving = Moving(Gray(200, 120));
  const absl::StatusOr<std::string> kitty =
      DrawFrame(LayoutOf(PictureFormat::kKitty, kTerminal), moving, 2);
  ISOSCOPE_ASSERT_OK(kitty);
  EXPECT_THAT(*kitty, HasSubstr("c=80,r=24,i=2"));
  const absl::StatusOr<std::string> sixel =
      DrawFrame(LayoutOf(PictureFormat::kSixel, kTerminal), moving, 1);
  ISOSCOPE_ASSERT_OK(sixel);
  const image::RgbaImage shown = testing::ReadTerminalBytes(*sixel).pictures.at(0).sixels;
  EXPECT_EQ(shown.width, 800);
  EXPECT_EQ(shown.height, 480);
  const absl::StatusOr<std::string> blocks =
      DrawFrame(LayoutOf(PictureFormat::kBlocks24Bit, kTerminal), moving, 1);
  ISOSCOPE_ASSERT_OK(blocks);
  const image::RgbaImage cells = testing::ReadTerminalBytes(*blocks).blocks;
  EXPECT_EQ(cells.width, 80);
  EXPECT_EQ(cells.height, 48);
}

TEST(DrawFrameTest, AFrameThatIsNoPictureIsAnError) {
  isoscope::v1::InteractResponse broken;
  broken.mutable_frame()->set_jpeg("no picture");
  EXPECT_THAT(DrawFrame(LayoutOf(PictureFormat::kSixel, kTerminal), broken, 1),
              testing::StatusIs(absl::StatusCode::kDataLoss));
}

}  // namespace
}  // namespace isoscope::cli
