#include "clients/cpp/picture_file/annotation_sheet.h"

#include <cstddef>
#include <vector>

#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::client {
namespace {

constexpr image::Rgba8 kGrey{100, 100, 100, 200};
constexpr Ink kRed{1, 0, 0};

image::RgbaImage GreyPicture(int width, int height) {
  return {.width = width,
          .height = height,
          .pixels = std::vector<image::Rgba8>(
              static_cast<std::size_t>(width) * static_cast<std::size_t>(height), kGrey)};
}

image::Rgba8 PixelAt(const image::RgbaImage& picture, int x, int y) {
  return picture.pixels[static_cast<std::size_t>(y * picture.width + x)];
}

TEST(AnnotationSheetTest, InkCoversItsPixelsAndTheOthersKeepTheirBits) {
  image::RgbaImage picture = GreyPicture(8, 6);
  const Sheet sheet(2, 1, 4, 4, 11, /*is_light=*/false);
  sheet.Paint({1, 0, 2, 3}, kRed, 1);
  std::vector<view::PixelRect> boxes;
  ISOSCOPE_ASSERT_OK(sheet.LayOver(&picture, &boxes));
  ASSERT_EQ(boxes.size(), 1U);
  EXPECT_EQ(boxes[0], (view::PixelRect{.begin_x = 3, .begin_y = 1, .end_x = 5, .end_y = 4}));
  for (int y = 0; y < picture.height; ++y) {
    for (int x = 0; x < picture.width; ++x) {
      const bool is_inked = x >= 3 && x < 5 && y >= 1 && y < 4;
      EXPECT_EQ(PixelAt(picture, x, y), is_inked ? (image::Rgba8{255, 0, 0, 255}) : kGrey)
          << x << " " << y;
    }
  }
}

TEST(AnnotationSheetTest, TranslucentInkIsBlendedOverATranslucentPicture) {
  image::RgbaImage picture = GreyPicture(1, 1);
  const Sheet sheet(0, 0, 1, 1, 11, /*is_light=*/false);
  sheet.Paint({0, 0, 1, 1}, kRed, 0.5);
  std::vector<view::PixelRect> boxes;
  ISOSCOPE_ASSERT_OK(sheet.LayOver(&picture, &boxes));
  // Alpha 0.502 + 0.784 * 0.498 = 0.892; red (0.502 + 0.392 * 0.390) / 0.892 = 0.734.
  const image::Rgba8 blended = PixelAt(picture, 0, 0);
  EXPECT_NEAR(blended.a, 228, 1);
  EXPECT_NEAR(blended.r, 187, 2);
  EXPECT_NEAR(blended.g, 44, 1);
  EXPECT_EQ(blended.g, blended.b);
}

TEST(AnnotationSheetTest, ASheetMayReachBeyondThePicture) {
  image::RgbaImage picture = GreyPicture(3, 3);
  std::vector<view::PixelRect> boxes;
  for (const int at : {-2, 2, 5}) {
    const Sheet sheet(at, at, 4, 4, 11, /*is_light=*/false);
    sheet.Paint({0, 0, 4, 4}, kRed, 1);
    ISOSCOPE_ASSERT_OK(sheet.LayOver(&picture, &boxes));
  }
  ASSERT_EQ(boxes.size(), 2U) << "the third sheet changes no pixel";
  EXPECT_EQ(boxes[0], (view::PixelRect{.begin_x = 0, .begin_y = 0, .end_x = 2, .end_y = 2}));
  EXPECT_EQ(boxes[1], (view::PixelRect{.begin_x = 2, .begin_y = 2, .end_x = 3, .end_y = 3}));
}

TEST(AnnotationSheetTest, ShapesHaveAnOutlineOfTheOppositeLightness) {
  for (const bool is_light : {false, true}) {
    image::RgbaImage picture = GreyPicture(21, 21);
    const Sheet sheet(0, 0, 21, 21, 20, is_light);
    sheet.FillRectangles({{8, 8, 5, 5}});
    std::vector<view::PixelRect> boxes;
    ISOSCOPE_ASSERT_OK(sheet.LayOver(&picture, &boxes));
    EXPECT_EQ(PixelAt(picture, 10, 10).r, is_light ? 0 : 255);
    EXPECT_EQ(PixelAt(picture, 7, 10).r > 180, is_light);
    EXPECT_EQ(PixelAt(picture, 7, 10).r < 60, !is_light);
    EXPECT_EQ(PixelAt(picture, 2, 10), kGrey);
  }
}

TEST(AnnotationSheetTest, TextIsAsWideAsItsSizeAndLength) {
  ISOSCOPE_ASSERT_OK(CheckFont());
  Sheet sheet(0, 0, 1, 1, 20, /*is_light=*/false);
  const double width = sheet.WidthOf("12.5 mm");
  EXPECT_NEAR(sheet.WidthOf("12.5 mm12.5 mm"), 2 * width, 0.1 * width);
  EXPECT_EQ(sheet.WidthOf(""), 0);
  sheet.SetTextPx(40);
  EXPECT_NEAR(sheet.WidthOf("12.5 mm"), 2 * width, 0.01 * width);
}

TEST(AnnotationSheetTest, OnlyUtf8IsText) {
  EXPECT_TRUE(IsUtf8(""));
  EXPECT_TRUE(IsUtf8("\xC3\xA9"));
  EXPECT_FALSE(IsUtf8("\xC3"));
  EXPECT_FALSE(IsUtf8("\xFF"));
}

}  // namespace
}  // namespace isoscope::client
