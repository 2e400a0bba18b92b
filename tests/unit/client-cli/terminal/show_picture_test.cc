#include "client-cli/terminal/show_picture.h"

#include <map>
#include <string>
#include <vector>

#include "gtest/gtest.h"

#include "clients/cpp/picture_file/picture_scaling.h"
#include "tests/support/status_matchers.h"
#include "tests/support/terminal_screen.h"

namespace isoscope::cli {
namespace {

using testing::ReadTerminalBytes;
using testing::TerminalScreen;

image::RgbaImage Gray(int width, int height) {
  return {
      .width = width,
      .height = height,
      .pixels = std::vector<image::Rgba8>(
          static_cast<std::size_t>(width) * static_cast<std::size_t>(height), {95, 95, 95, 255})};
}

TEST(PictureDisplayTest, PixelsFitTheWindowAboveTheText) {
  // 20 rows of 20 pixels, of which 4 are kept free.
  const PictureDisplay display(PictureFormat::kSixel, TerminalSize{100, 20, {1000, 400}});
  EXPECT_EQ(display.SizeOf({1024, 1024}), (view::Viewport{320, 320}));
  EXPECT_EQ(display.SizeOf({4000, 1000}), (view::Viewport{1000, 250}));
  EXPECT_EQ(display.SizeOf({64, 48}), (view::Viewport{64, 48}));
}

TEST(PictureDisplayTest, BlocksKeepTheShapeOfThePicture) {
  // Without a known character size the usual one applies, twice as high as wide: half blocks are
  // squares.
  const PictureDisplay usual(PictureFormat::kBlocks24Bit, TerminalSize{80, 24, {}});
  EXPECT_EQ(usual.SizeOf({1024, 1024}), (view::Viewport{40, 40}));
  EXPECT_EQ(usual.SizeOf({1024, 256}), (view::Viewport{80, 20}));
  // Characters 10 x 25: half blocks are a quarter higher than wide.
  const PictureDisplay tall(PictureFormat::kBlocks256, TerminalSize{80, 24, {800, 600}});
  EXPECT_EQ(tall.SizeOf({1024, 1024}), (view::Viewport{50, 40}));
}

TEST(PictureDisplayTest, ATinyWindowStillShowsSomething) {
  for (const PictureFormat format : {PictureFormat::kBlocks256, PictureFormat::kKitty}) {
    const PictureDisplay display(format, TerminalSize{1, 1, {}});
    const view::Viewport size = display.SizeOf({1024, 768});
    EXPECT_GE(size.width_px, 1);
    EXPECT_GE(size.height_px, 1);
  }
}

TEST(PictureDisplayTest, EveryFormatGivesThePictureBack) {
  const TerminalSize terminal{100, 40, {1000, 800}};
  const image::RgbaImage picture = Gray(30, 20);
  for (const PictureFormat format : {PictureFormat::kKitty, PictureFormat::kITerm2}) {
    const absl::StatusOr<std::string> text = PictureDisplay(format, terminal).Encode(picture);
    ISOSCOPE_ASSERT_OK(text);
    const TerminalScreen screen = ReadTerminalBytes(*text);
    ASSERT_EQ(screen.pictures.size(), 1);
    const absl::StatusOr<image::RgbaImage> decoded = image::DecodePng(screen.pictures[0].file);
    ISOSCOPE_ASSERT_OK(decoded);
    EXPECT_EQ(*decoded, picture);
    EXPECT_EQ(text->back(), '\n');
  }
  const absl::StatusOr<std::string> blocks =
      PictureDisplay(PictureFormat::kBlocks256, terminal).Encode(picture);
  ISOSCOPE_ASSERT_OK(blocks);
  EXPECT_EQ(ReadTerminalBytes(*blocks).blocks, picture);
  for (const PictureFormat format : {PictureFormat::kBlocks16, PictureFormat::kBlocks8}) {
    const absl::StatusOr<std::string> few = PictureDisplay(format, terminal).Encode(picture);
    ISOSCOPE_ASSERT_OK(few);
    EXPECT_EQ(ReadTerminalBytes(*few).blocks.width, picture.width);
    EXPECT_EQ(ReadTerminalBytes(*few).blocks.height, picture.height);
  }
}

TEST(PictureDisplayTest, AWindowWithoutPixelsGetsABoxOfCharacters) {
  const PictureDisplay display(PictureFormat::kKitty, TerminalSize{80, 24, {}});
  const absl::StatusOr<std::string> text =
      display.Encode(client::ScalePicture(Gray(1024, 1024), display.SizeOf({1024, 1024})));
  ISOSCOPE_ASSERT_OK(text);
  EXPECT_NE(text->find(",c=40,r=20"), std::string::npos) << text->substr(0, 80);
}

TEST(PictureDisplayTest, AFileGetsThePictureAsItIs) {
  const PictureDisplay display(PictureFormat::kSixel, std::nullopt);
  EXPECT_EQ(display.SizeOf({3000, 2000}), (view::Viewport{3000, 2000}));
  EXPECT_EQ(PictureDisplay(PictureFormat::kBlocks256, std::nullopt).SizeOf({3000, 6000}),
            (view::Viewport{80, 160}));
}

TEST(FormatOfTest, BlocksHaveTheColoursOfTheTerminal) {
  const auto terminal_named = [](const std::string& term) {
    return [term](const char* name) { return name == std::string("TERM") ? term : ""; };
  };
  EXPECT_EQ(FormatOf(ShowMode::kBlocks, terminal_named("xterm-direct")),
            PictureFormat::kBlocks24Bit);
  EXPECT_EQ(FormatOf(ShowMode::kBlocks, terminal_named("xterm")), PictureFormat::kBlocks256);
  EXPECT_EQ(FormatOf(ShowMode::kBlocks, terminal_named("dumb")), PictureFormat::kBlocks256);
  EXPECT_EQ(FormatOf(ShowMode::kBlocks, terminal_named("linux")), PictureFormat::kBlocks8);
  EXPECT_EQ(FormatOf(ShowMode::kBlocks, terminal_named("rxvt-16color")), PictureFormat::kBlocks16);
  EXPECT_EQ(FormatOf(ShowMode::kSixel, terminal_named("dumb")), PictureFormat::kSixel);
  EXPECT_EQ(FormatOf(ShowMode::kAuto, terminal_named("xterm-direct")), std::nullopt);
}

}  // namespace
}  // namespace isoscope::cli
