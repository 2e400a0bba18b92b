#include "clients/cpp/picture_file/picture_scaling.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "gtest/gtest.h"

#include "core/picture/linear_light.h"

namespace isoscope::client {
namespace {

using image::Rgba8;
using image::RgbaImage;

RgbaImage Filled(int width, int height, Rgba8 color) {
  return {.width = width,
          .height = height,
          .pixels = std::vector<Rgba8>(
              static_cast<std::size_t>(width) * static_cast<std::size_t>(height), color)};
}

// Each channel has its own pattern: coordinates and sums in 8 bits.
RgbaImage Pattern(int width, int height) {
  RgbaImage image = Filled(width, height, {});
  std::size_t i = 0;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x, ++i) {
      image.pixels[i] = {static_cast<std::uint8_t>(x * 7), static_cast<std::uint8_t>(y * 11),
                         static_cast<std::uint8_t>((x ^ y) * 5),
                         static_cast<std::uint8_t>(x % 3 == 0 ? 0 : 255 - y)};
    }
  }
  return image;
}

TEST(FitInsideTest, KeepsTheShapeAndNeverEnlarges) {
  EXPECT_EQ(FitInside({1024, 1024}, {640, 480}, 1), (view::Viewport{480, 480}));
  EXPECT_EQ(FitInside({1024, 512}, {640, 480}, 1), (view::Viewport{640, 320}));
  EXPECT_EQ(FitInside({100, 50}, {640, 480}, 1), (view::Viewport{100, 50}));
  // Pixels that are twice as high as wide.
  EXPECT_EQ(FitInside({1024, 1024}, {80, 80}, 2), (view::Viewport{80, 40}));
  // Pixels that are twice as wide as high: a picture of 100 x 50 has 25 columns and no 100 rows.
  EXPECT_EQ(FitInside({100, 50}, {640, 480}, 0.5), (view::Viewport{50, 50}));
  // No side vanishes.
  EXPECT_EQ(FitInside({65536, 1}, {80, 40}, 1), (view::Viewport{80, 1}));
  EXPECT_EQ(FitInside({1, 65536}, {80, 1}, 1), (view::Viewport{1, 1}));
}

TEST(ScalePictureTest, LeavesAPictureOfThatSizeAsItIs) {
  const RgbaImage picture = Pattern(19, 13);
  EXPECT_EQ(ScalePicture(picture, {19, 13}), picture);
}

TEST(ScalePictureTest, OneColourStaysThatColourAtEverySize) {
  const Rgba8 color{12, 130, 255, 255};
  for (const view::Viewport size : {view::Viewport{1, 1}, {3, 7}, {10, 9}, {31, 2}, {64, 64}}) {
    EXPECT_EQ(ScalePicture(Filled(10, 9, color), size),
              Filled(size.width_px, size.height_px, color))
        << size.width_px;
  }
}

TEST(ScalePictureTest, MixesInLinearLight) {
  RgbaImage picture = Filled(2, 1, {0, 0, 0, 255});
  picture.pixels[1] = {255, 255, 255, 255};
  // Half of the light is 188 in sRGB; half of the value would be 128.
  EXPECT_EQ(ScalePicture(picture, {1, 1}).pixels[0], (Rgba8{188, 188, 188, 255}));
}

TEST(ScalePictureTest, PixelsThatDoNotShowLendNoColour) {
  RgbaImage picture = Filled(2, 1, {255, 0, 0, 0});
  picture.pixels[1] = {0, 255, 0, 255};
  EXPECT_EQ(ScalePicture(picture, {1, 1}).pixels[0], (Rgba8{0, 255, 0, 128}));
  EXPECT_EQ(ScalePicture(Filled(4, 4, {9, 9, 9, 0}), {2, 2}), Filled(2, 2, {}));
}

TEST(ScalePictureTest, AWholeFactorIsTheMeanOfTheSamples) {
  const RgbaImage picture = Pattern(12, 12);
  const RgbaImage small = ScalePicture(picture, {4, 4});
  const picture::LinearLightTables& tables = picture::LinearLight();
  for (int y = 0; y < 4; ++y) {
    for (int x = 0; x < 4; ++x) {
      double light = 0;
      double alpha = 0;
      for (int i = 0; i < 9; ++i) {
        const Rgba8 sample =
            picture.pixels[static_cast<std::size_t>((3 * y + i / 3) * 12 + 3 * x + i % 3)];
        light += static_cast<double>(sample.a) * tables.light[sample.g];
        alpha += sample.a;
      }
      const Rgba8 pixel = small.pixels[static_cast<std::size_t>(4 * y + x)];
      EXPECT_NEAR(pixel.a, alpha / 9, 0.51);
      EXPECT_NEAR(tables.light[pixel.g], light / alpha, 300);
    }
  }
}

TEST(ScalePictureTest, DoublesEveryPixelWhenTwiceAsLarge) {
  const RgbaImage picture = Pattern(5, 3);
  const RgbaImage large = ScalePicture(picture, {10, 6});
  for (int y = 0; y < 6; ++y) {
    for (int x = 0; x < 10; ++x) {
      const Rgba8 from = picture.pixels[static_cast<std::size_t>((y / 2) * 5 + x / 2)];
      EXPECT_EQ(large.pixels[static_cast<std::size_t>(y * 10 + x)], from.a == 0 ? Rgba8{} : from);
    }
  }
}

TEST(PictureScalerTest, PiecesGiveThePictureOfTheWhole) {
  const RgbaImage picture = Pattern(37, 29);
  PictureScaler scaler({37, 29}, {11, 8});
  for (int y = 0; y < 29; y += 10) {
    for (int x = 0; x < 37; x += 16) {
      RgbaImage piece{.width = std::min(16, 37 - x), .height = std::min(10, 29 - y), .pixels = {}};
      for (int row = y; row < y + piece.height; ++row) {
        for (int column = x; column < x + piece.width; ++column) {
          piece.pixels.push_back(picture.pixels[static_cast<std::size_t>(row * 37 + column)]);
        }
      }
      scaler.Add(x, y, piece);
    }
  }
  const RgbaImage whole = ScalePicture(picture, {11, 8});
  const RgbaImage pieces = scaler.Finish();
  for (std::size_t i = 0; i < whole.pixels.size(); ++i) {
    // Sums in another order may round another way.
    EXPECT_NEAR(whole.pixels[i].r, pieces.pixels[i].r, 1);
    EXPECT_NEAR(whole.pixels[i].a, pieces.pixels[i].a, 1);
  }
}

}  // namespace
}  // namespace isoscope::client
