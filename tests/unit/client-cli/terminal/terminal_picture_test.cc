// Pictures are decoded again from the bytes, by decoders of our own.

#include "client-cli/terminal/terminal_picture.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/terminal_screen.h"

namespace isoscope::cli {
namespace {

using image::Rgba8;
using image::RgbaImage;
using ::testing::HasSubstr;
using ::testing::StartsWith;

// Sixel gives colours in percent.
constexpr int kSixelTolerance = 2;

constexpr Rgba8 kRed{255, 0, 0, 255};
constexpr Rgba8 kGreen{0, 255, 0, 255};
constexpr Rgba8 kBlue{0, 0, 255, 255};
constexpr Rgba8 kNothing{0, 0, 0, 0};

// Few colours, so that palettes hold all of them.
RgbaImage Tiles(int width, int height) {
  RgbaImage image{.width = width, .height = height, .pixels = {}};
  const std::array<Rgba8, 5> colors = {kRed, kGreen, kBlue, Rgba8{51, 102, 153, 255},
                                       Rgba8{255, 255, 255, 255}};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      image.pixels.push_back(colors[static_cast<std::size_t>((x / 3 + y / 2) % 5)]);
    }
  }
  return image;
}

void ExpectNear(const RgbaImage& a, const RgbaImage& b, int tolerance) {
  ASSERT_EQ(a.width, b.width);
  ASSERT_EQ(a.height, b.height);
  for (std::size_t i = 0; i < a.pixels.size(); ++i) {
    ASSERT_EQ(a.pixels[i].a, b.pixels[i].a) << i;
    ASSERT_NEAR(a.pixels[i].r, b.pixels[i].r, tolerance) << i;
    ASSERT_NEAR(a.pixels[i].g, b.pixels[i].g, tolerance) << i;
    ASSERT_NEAR(a.pixels[i].b, b.pixels[i].b, tolerance) << i;
  }
}

TEST(KittyPictureTest, AShortPictureIsOneMessage) {
  EXPECT_EQ(KittyPicture("abc", {}), "\x1B_Ga=T,f=100,q=2,m=0;YWJj\x1B\\");
  EXPECT_EQ(KittyPicture("abc", {.box = {40, 20}, .image_number = 3}),
            "\x1B_Ga=T,f=100,q=2,c=40,r=20,i=3,p=1,C=1,m=0;YWJj\x1B\\");
  EXPECT_EQ(KittyRemoval(3), "\x1B_Ga=d,d=I,i=3,q=2\x1B\\");
}

TEST(KittyPictureTest, ChunksHoldAtMost4096CharactersAndGiveTheFileBack) {
  for (const std::size_t size : {3072UL, 3073UL, 6144UL, 10'000UL}) {
    std::string png;
    for (std::size_t i = 0; i < size; ++i) {
      png += static_cast<char>(i * 7 + i / 256);
    }
    const std::string text = KittyPicture(png, {});
    const std::vector<testing::ShownPicture> shown = testing::ReadTerminalBytes(text).pictures;
    ASSERT_EQ(shown.size(), 1) << size;
    EXPECT_EQ(shown[0].file, png);
    EXPECT_LE(shown[0].longest_chunk, 4096);
  }
}

TEST(ITerm2PictureTest, SaysTheSizeInPixelsOrCharacters) {
  EXPECT_EQ(
      ITerm2Picture("abc", {640, 480}, {}),
      "\x1B]1337;File=inline=1;size=3;width=640px;height=480px;preserveAspectRatio=1:YWJj\x07");
  EXPECT_THAT(ITerm2Picture("abc", {640, 480}, {40, 15}), HasSubstr(";width=40;height=15;"));
  EXPECT_EQ(testing::ReadTerminalBytes(ITerm2Picture("\x89PNG", {1, 1}, {})).pictures[0].file,
            "\x89PNG");
}

TEST(SixelPictureTest, FewColoursComeBackAsTheyWere) {
  for (const SixelQuality quality : {SixelQuality::kFast, SixelQuality::kBest}) {
    // 6 rows are a band: whole bands, and one that is cut.
    for (const int height : {6, 12, 17}) {
      const RgbaImage picture = Tiles(23, height);
      const absl::StatusOr<std::string> sixel = SixelPicture(picture, quality);
      ISOSCOPE_ASSERT_OK(sixel);
      EXPECT_THAT(*sixel, StartsWith("\x1BP"));
      const std::vector<testing::ShownPicture> shown = testing::ReadTerminalBytes(*sixel).pictures;
      ASSERT_EQ(shown.size(), 1);
      ExpectNear(shown[0].sixels, picture, kSixelTolerance);
    }
  }
}

TEST(SixelPictureTest, PixelsWithoutAlphaStayAsTheTerminalIs) {
  RgbaImage picture = Tiles(20, 14);
  for (std::size_t i = 0; i < picture.pixels.size(); i += 3) {
    picture.pixels[i] = kNothing;
  }
  const absl::StatusOr<std::string> sixel = SixelPicture(picture, SixelQuality::kBest);
  ISOSCOPE_ASSERT_OK(sixel);
  const std::vector<testing::ShownPicture> shown = testing::ReadTerminalBytes(*sixel).pictures;
  ASSERT_EQ(shown.size(), 1);
  EXPECT_TRUE(shown[0].keeps_background);
  ExpectNear(shown[0].sixels, picture, kSixelTolerance);
}

TEST(SixelPictureTest, ManyColoursAreTrueInTheMean) {
  RgbaImage picture{.width = 128, .height = 96, .pixels = {}};
  for (int y = 0; y < 96; ++y) {
    for (int x = 0; x < 128; ++x) {
      picture.pixels.push_back({static_cast<std::uint8_t>(2 * x), static_cast<std::uint8_t>(2 * y),
                                static_cast<std::uint8_t>(x + y), 255});
    }
  }
  const absl::StatusOr<std::string> sixel = SixelPicture(picture, SixelQuality::kBest);
  ISOSCOPE_ASSERT_OK(sixel);
  const RgbaImage shown = testing::ReadTerminalBytes(*sixel).pictures.at(0).sixels;
  ASSERT_EQ(shown.width, 128);
  ASSERT_EQ(shown.height, 96);
  double difference = 0;
  for (std::size_t i = 0; i < shown.pixels.size(); ++i) {
    difference += shown.pixels[i].g - picture.pixels[i].g;
  }
  EXPECT_LT(std::abs(difference) / static_cast<double>(shown.pixels.size()), 4);
}

TEST(SixelPictureTest, APictureOfNothingIsNoError) {
  const RgbaImage picture{.width = 5, .height = 7, .pixels = std::vector<Rgba8>(35, kNothing)};
  const absl::StatusOr<std::string> sixel = SixelPicture(picture, SixelQuality::kBest);
  ISOSCOPE_ASSERT_OK(sixel);
  for (const testing::ShownPicture& shown : testing::ReadTerminalBytes(*sixel).pictures) {
    for (const Rgba8& pixel : shown.sixels.pixels) {
      EXPECT_EQ(pixel.a, 0);
    }
  }
}

TEST(BlockPictureTest, KnownBytes) {
  const RgbaImage picture{.width = 2, .height = 2, .pixels = {kRed, kRed, kBlue, kRed}};
  EXPECT_EQ(BlockPicture(picture, BlockColors::k24Bit, "\n"),
            "\x1B[48;2;0;0;255m\x1B[38;2;255;0;0m\xE2\x96\x80\x1B[48;2;255;0;0m \x1B[0m");
  EXPECT_EQ(BlockPicture(picture, BlockColors::k256, "\n"),
            "\x1B[48;5;21m\x1B[38;5;196m\xE2\x96\x80\x1B[48;5;196m \x1B[0m");
  EXPECT_EQ(BlockPicture(picture, BlockColors::k16, "\n"),
            "\x1B[104m\x1B[91m\xE2\x96\x80\x1B[101m \x1B[0m");
  EXPECT_EQ(BlockPicture(picture, BlockColors::k8, "\n"),
            "\x1B[44m\x1B[31m\xE2\x96\x80\x1B[41m \x1B[0m");
}

TEST(BlockPictureTest, PixelsWithoutAlphaStayAsTheTerminalIs) {
  const RgbaImage upper{.width = 1, .height = 2, .pixels = {kRed, kNothing}};
  EXPECT_EQ(BlockPicture(upper, BlockColors::k24Bit, "\n"),
            "\x1B[38;2;255;0;0m\xE2\x96\x80\x1B[0m");
  const RgbaImage lower{.width = 1, .height = 2, .pixels = {kNothing, kRed}};
  EXPECT_EQ(BlockPicture(lower, BlockColors::k24Bit, "\n"),
            "\x1B[38;2;255;0;0m\xE2\x96\x84\x1B[0m");
  const RgbaImage none{.width = 1, .height = 2, .pixels = {kNothing, kNothing}};
  EXPECT_EQ(BlockPicture(none, BlockColors::k24Bit, "\n"), " \x1B[0m");
}

TEST(BlockPictureTest, EveryPixelComesBackInBothKindsOfColours) {
  const RgbaImage picture = Tiles(17, 9);  // the last row is half a character
  const testing::TerminalScreen all =
      testing::ReadTerminalBytes(BlockPicture(picture, BlockColors::k24Bit, "\n"));
  RgbaImage blocks = all.blocks;
  ASSERT_EQ(blocks.height, 10);
  for (int x = 0; x < 17; ++x) {
    EXPECT_EQ(blocks.pixels[static_cast<std::size_t>(9 * 17 + x)].a, 0);
  }
  blocks.height = 9;
  blocks.pixels.resize(17 * 9);
  EXPECT_EQ(blocks, picture);
  const testing::TerminalScreen few =
      testing::ReadTerminalBytes(BlockPicture(picture, BlockColors::k256, "\n"));
  blocks = few.blocks;
  blocks.height = 9;
  blocks.pixels.resize(17 * 9);
  ExpectNear(blocks, picture, 95);  // the longest step of the cube
}

// A picture of one colour, as a terminal shows it.
RgbaImage ShownOf(Rgba8 color, BlockColors colors, int width = 8, int height = 8) {
  const RgbaImage picture{
      .width = width,
      .height = height,
      .pixels = std::vector<Rgba8>(
          static_cast<std::size_t>(width) * static_cast<std::size_t>(height), color)};
  return testing::ReadTerminalBytes(BlockPicture(picture, colors, "\n")).blocks;
}

// Symptom: smooth surfaces fell into patches of one colour each.
TEST(DitherTest, TheMeanOfXtermsColoursIsThatOfThePicture) {
  for (const Rgba8 color : {Rgba8{120, 110, 100, 255}, Rgba8{200, 180, 161, 255},
                            Rgba8{40, 60, 20, 255}, Rgba8{103, 103, 103, 255}}) {
    const RgbaImage shown = ShownOf(color, BlockColors::k256);
    ASSERT_EQ(shown.pixels.size(), 64);
    double red = 0;
    double green = 0;
    double blue = 0;
    for (const Rgba8& pixel : shown.pixels) {
      red += pixel.r / 64.0;
      green += pixel.g / 64.0;
      blue += pixel.b / 64.0;
    }
    // Of 16 thresholds over a step of at most 95 levels.
    EXPECT_NEAR(red, color.r, 95.0 / 32);
    EXPECT_NEAR(green, color.g, 95.0 / 32);
    EXPECT_NEAR(blue, color.b, 95.0 / 32);
  }
}

TEST(DitherTest, AShareOfThePixelsIsLitInFewColours) {
  for (const BlockColors colors : {BlockColors::k16, BlockColors::k8}) {
    // Three of eight, in each channel for itself.
    const RgbaImage shown = ShownOf(Rgba8{96, 255, 0, 255}, colors);
    int red = 0;
    for (const Rgba8& pixel : shown.pixels) {
      red += pixel.r > 100 ? 1 : 0;
      EXPECT_GT(pixel.g, 200);
      EXPECT_EQ(pixel.b, 0);
    }
    EXPECT_EQ(red, 24);
  }
}

TEST(DitherTest, GreyGetsNoHue) {
  for (const BlockColors colors : {BlockColors::k256, BlockColors::k16, BlockColors::k8}) {
    for (int level = 0; level < 256; level += 5) {
      const auto gray = static_cast<std::uint8_t>(level);
      for (const Rgba8& pixel : ShownOf({gray, gray, gray, 255}, colors).pixels) {
        EXPECT_TRUE(pixel.r == pixel.g && pixel.g == pixel.b) << level;
      }
    }
  }
}

TEST(DitherTest, ColoursOfXtermsPaletteStay) {
  for (int index = 16; index < 256; ++index) {
    const Rgba8 color = testing::XtermColor(index);
    for (const Rgba8& pixel : ShownOf(color, BlockColors::k256, 4, 4).pixels) {
      EXPECT_EQ(pixel, color) << index;
    }
  }
}

TEST(DitherTest, ColoursOf24BitsAreNotDithered) {
  const Rgba8 color{121, 110, 99, 255};
  for (const Rgba8& pixel : ShownOf(color, BlockColors::k24Bit).pixels) {
    EXPECT_EQ(pixel, color);
  }
}

}  // namespace
}  // namespace isoscope::cli
