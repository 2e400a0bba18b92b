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
  ExpectNear(blocks, picture, 48);
}

TEST(NearestXtermColorTest, NoOtherColourOfThePaletteIsNearer) {
  for (int red = 0; red < 256; red += 15) {
    for (int green = 0; green < 256; green += 17) {
      for (int blue = 0; blue < 256; blue += 51) {
        const Rgba8 color{static_cast<std::uint8_t>(red), static_cast<std::uint8_t>(green),
                          static_cast<std::uint8_t>(blue), 255};
        const auto distance = [&](int index) {
          const Rgba8 other = testing::XtermColor(index);
          return (color.r - other.r) * (color.r - other.r) +
                 (color.g - other.g) * (color.g - other.g) +
                 (color.b - other.b) * (color.b - other.b);
        };
        const int chosen = distance(NearestXtermColor(color));
        for (int index = 16; index < 256; ++index) {
          // The grey is chosen by the mean of the channels.
          EXPECT_LE(chosen, distance(index) + 100) << red << " " << green << " " << blue;
        }
      }
    }
  }
}

}  // namespace
}  // namespace isoscope::cli
