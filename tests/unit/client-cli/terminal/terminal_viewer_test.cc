// The loop itself, on a terminal: tests/integration/terminal_program_test.cc.

#include "client-cli/terminal/terminal_viewer.h"

#include <optional>
#include <string>
#include <vector>

#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/image/jpeg_codec.h"
#include "core/image/png_codec.h"
#include "core/rpc/proto_convert.h"
#include "tests/support/status_matchers.h"
#include "tests/support/terminal_screen.h"

namespace isoscope::cli {
namespace {

using ::testing::HasSubstr;

constexpr TerminalSize kTerminal{80, 25, {800, 500}};

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

// The time of the newest state gave a frame 1 s where it had taken 5.
TEST(SentStatesTest, TheLatencyIsThatOfTheStateOfTheFrameWhileNewerOnesAreUnderWay) {
  const absl::Time start = absl::UnixEpoch();
  SentStates sent;
  sent.Add(1, start);
  sent.Add(2, start + absl::Seconds(4));
  EXPECT_EQ(sent.TakeLatency(1, start + absl::Seconds(5)), absl::Seconds(5));
  EXPECT_EQ(sent.TakeLatency(2, start + absl::Seconds(6)), absl::Seconds(2));
  // The exact frame answers the same state.
  EXPECT_EQ(sent.TakeLatency(2, start + absl::Seconds(7)), absl::Seconds(3));
}

TEST(SentStatesTest, AFrameOfAnUnknownStateHasNoLatency) {
  SentStates sent;
  EXPECT_EQ(sent.TakeLatency(1, absl::UnixEpoch()), std::nullopt);
  for (int sequence_number = 1; sequence_number <= 1000; ++sequence_number) {
    sent.Add(sequence_number, absl::UnixEpoch());
  }
  EXPECT_EQ(sent.TakeLatency(1, absl::UnixEpoch()), std::nullopt);
  EXPECT_EQ(sent.TakeLatency(1000, absl::UnixEpoch()), absl::ZeroDuration());
  EXPECT_EQ(sent.TakeLatency(999, absl::UnixEpoch()), std::nullopt);
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

TEST(FlagsOfFrameTest, NumbersAreReadAsTheSameBits) {
  isoscope::v1::RenderIsosurfaceRequest frame;
  frame.set_isovalue(0.1);
  frame.mutable_viewport()->set_width_px(640);
  frame.mutable_viewport()->set_height_px(480);
  frame.mutable_camera()->mutable_eye()->set_x(1.0 / 3);
  frame.mutable_camera()->mutable_up()->set_y(1);
  EXPECT_EQ(FlagsOfFrame(frame),
            "--isovalue 0.1 --eye 0.3333333333333333,0.0,0.0 --target 0.0,0.0,0.0 --up 0.0,1.0,0.0 "
            "--width 640 --height 480");
}

}  // namespace
}  // namespace isoscope::cli
