#include "client-cli/annotations.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

// Fontconfig keeps what it has found until the process ends.
// NOLINTNEXTLINE(bugprone-reserved-identifier, readability-identifier-naming): LeakSanitizer's name
extern "C" const char* __lsan_default_suppressions() { return "leak:libfontconfig"; }

namespace isoscope::cli {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

constexpr image::Rgba8 kBlack{0, 0, 0, 255};

image::RgbaImage Plain(int width, int height, const image::Rgba8& pixel = kBlack) {
  image::RgbaImage picture{.width = width, .height = height, .pixels = {}};
  picture.pixels.assign(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), pixel);
  return picture;
}

AnnotationScene Orthographic(double view_height, int viewport_height_px) {
  AnnotationScene scene;
  scene.camera = {.eye = {0, 0, 10},
                  .target = {0, 0, 0},
                  .up = {0, 1, 0},
                  .projection = view::Projection::kOrthographic,
                  .view_height = view_height};
  scene.viewport_height_px = viewport_height_px;
  scene.isovalues = {62.5};
  return scene;
}

AnnotationScene Perspective(double distance, double fov_y_radians, int viewport_height_px) {
  AnnotationScene scene = Orthographic(0, viewport_height_px);
  scene.camera.eye = {0, 0, distance};
  scene.camera.projection = view::Projection::kPerspective;
  scene.camera.fov_y_radians = fov_y_radians;
  return scene;
}

bool IsInside(const std::vector<view::PixelRect>& boxes, int x, int y) {
  return std::any_of(boxes.begin(), boxes.end(), [&](const view::PixelRect& box) {
    return x >= box.begin_x && x < box.end_x && y >= box.begin_y && y < box.end_y;
  });
}

TEST(AnnotationsTest, ScaleBarIsTheLongestOneTwoFiveThatFits) {
  struct Case {
    double view_height;
    double world_length;
  };
  for (const Case& c : std::vector<Case>{{500, 100},
                                         {499, 50},
                                         {250, 50},
                                         {249, 20},
                                         {100, 20},
                                         {99, 10},
                                         {50, 10},
                                         {5e-7, 1e-7},
                                         {5e12, 1e12}}) {
    // 500 pixels high, at most 100 of them: a fifth of the height.
    const ScaleBar bar = MakeScaleBar(Orthographic(c.view_height, 500), 100);
    EXPECT_NEAR(bar.world_length, c.world_length, 1e-9 * c.world_length) << c.view_height;
    EXPECT_NEAR(bar.length_px, bar.world_length / c.view_height * 500, 1e-9);
    EXPECT_LE(bar.length_px, 100 * (1 + 1e-12));
  }
  EXPECT_EQ(MakeScaleBar(Orthographic(500, 500), 100).label, "100 units");
  EXPECT_EQ(MakeScaleBar(Orthographic(0.5, 500), 100).label, "0.1 units");
}

TEST(AnnotationsTest, PerspectiveScaleBarHoldsAtTheTargetAndSaysSo) {
  // tan(45 degrees) = 1: at distance 50 the picture is 100 high.
  const ScaleBar bar = MakeScaleBar(Perspective(50, std::acos(-1.0) / 2, 500), 100);
  EXPECT_EQ(bar.world_length, 20);
  EXPECT_NEAR(bar.length_px, 100, 1e-9);
  EXPECT_EQ(bar.label, "20 units at the target");
}

TEST(AnnotationsTest, DrawnBarHasItsLengthToAPartOfAPixel) {
  for (const double view_height : {300.0, 317.3, 333.333}) {
    const AnnotationScene scene = Orthographic(view_height, 400);
    const ScaleBar bar = MakeScaleBar(scene, 0.25 * 600);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Annotated annotated,
                                  Annotate({.has_scale_bar = true}, scene, Plain(600, 400)));
    // White ink on black, whose outline does not show: the brightest row is the bar's.
    double brightest = 0;
    for (int y = 0; y < 400; ++y) {
      double sum = 0;
      for (int x = 0; x < 600; ++x) {
        sum += annotated.picture
                   .pixels[std::size_t{600} * static_cast<std::size_t>(y) +
                           static_cast<std::size_t>(x)]
                   .g /
               255.0;
      }
      brightest = std::max(brightest, sum);
    }
    EXPECT_NEAR(brightest, bar.length_px, 0.02) << view_height;
  }
}

TEST(AnnotationsTest, AxesFollowTheCamera) {
  view::Camera camera = Orthographic(1, 1).camera;
  auto axes = AxisDirections(camera);
  EXPECT_EQ(axes[0], (math::Vec3d{1, 0, 0})) << "x to the right";
  EXPECT_EQ(axes[1], (math::Vec3d{0, 1, 0})) << "y up";
  EXPECT_EQ(axes[2], (math::Vec3d{0, 0, -1})) << "z at the eye";
  camera.eye = {10, 0, 0};
  camera.up = {0, 0, 5};  // of any length
  axes = AxisDirections(camera);
  EXPECT_EQ(axes[0], (math::Vec3d{0, 0, -1}));
  EXPECT_EQ(axes[1], (math::Vec3d{1, 0, 0}));
  EXPECT_EQ(axes[2], (math::Vec3d{0, 1, 0}));
}

TEST(AnnotationsTest, PixelsOutsideTheBoxesKeepTheirBitsAlsoTranslucentOnes) {
  image::RgbaImage picture = Plain(320, 240);
  for (std::size_t i = 0; i < picture.pixels.size(); ++i) {
    picture.pixels[i] = {static_cast<std::uint8_t>(i), static_cast<std::uint8_t>(i / 7),
                         static_cast<std::uint8_t>(i / 99), static_cast<std::uint8_t>(i / 13)};
  }
  AnnotationFlags flags{.has_axes = true, .has_scale_bar = true, .caption = "Two\\nlines"};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Annotated annotated,
                                Annotate(flags, Orthographic(100, 240), picture));
  EXPECT_EQ(annotated.boxes.size(), 3U);
  int changed = 0;
  for (int y = 0; y < 240; ++y) {
    for (int x = 0; x < 320; ++x) {
      const auto i = std::size_t{320} * static_cast<std::size_t>(y) + static_cast<std::size_t>(x);
      if (annotated.picture.pixels[i] != picture.pixels[i]) {
        ++changed;
        EXPECT_TRUE(IsInside(annotated.boxes, x, y)) << x << " " << y;
      }
    }
  }
  EXPECT_GT(changed, 300);
  // A corner without an annotation.
  EXPECT_FALSE(IsInside(annotated.boxes, 310, 10));
}

TEST(AnnotationsTest, SameCallsGiveTheSamePixelsAndTheIsovalueShows) {
  const AnnotationFlags flags{.has_axes = true, .caption = "at {isovalue}"};
  AnnotationScene scene = Orthographic(100, 240);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Annotated a, Annotate(flags, scene, Plain(320, 240)));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Annotated b, Annotate(flags, scene, Plain(320, 240)));
  EXPECT_EQ(a.picture, b.picture);
  EXPECT_EQ(a.boxes, b.boxes);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const Annotated typed,
      Annotate({.has_axes = true, .caption = "at 62.5"}, scene, Plain(320, 240)));
  EXPECT_EQ(a.picture, typed.picture);
  scene.isovalues = {63};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Annotated other, Annotate(flags, scene, Plain(320, 240)));
  EXPECT_NE(a.picture, other.picture);
}

TEST(AnnotationsTest, InkIsDarkOnALightBackground) {
  const AnnotationFlags flags{.has_scale_bar = true};
  AnnotationScene scene = Orthographic(100, 240);
  scene.is_background_light = true;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Annotated annotated,
                                Annotate(flags, scene, Plain(320, 240, {255, 255, 255, 255})));
  EXPECT_TRUE(std::any_of(annotated.picture.pixels.begin(), annotated.picture.pixels.end(),
                          [](const image::Rgba8& p) { return p.r + p.g + p.b == 0; }));
}

TEST(AnnotationsTest, TransparentBackgroundShowsThroughBesideTheInk) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const Annotated annotated,
      Annotate({.has_scale_bar = true}, Orthographic(100, 240), Plain(320, 240, {})));
  const auto count_of = [&](int alpha) {
    return std::count_if(annotated.picture.pixels.begin(), annotated.picture.pixels.end(),
                         [&](const image::Rgba8& p) { return p.a == alpha; });
  };
  EXPECT_GT(count_of(255), 50);
  EXPECT_GT(count_of(0), 320 * 240 / 2);
}

TEST(AnnotationsTest, SmallestAndOddestPicturesAreNoCrash) {
  const AnnotationFlags flags{
      .has_axes = true, .has_scale_bar = true, .caption = std::string(3000, 'x')};
  for (const auto& [width, height] :
       std::vector<std::pair<int, int>>{{1, 1}, {2, 300}, {300, 2}, {64, 64}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Annotated annotated,
                                  Annotate(flags, Orthographic(100, height), Plain(width, height)));
    for (const view::PixelRect& box : annotated.boxes) {
      EXPECT_GE(box.begin_x, 0);
      EXPECT_GE(box.begin_y, 0);
      EXPECT_LE(box.end_x, width);
      EXPECT_LE(box.end_y, height);
    }
  }
}

TEST(AnnotationsTest, CaptionThatIsNotUtf8IsRefused) {
  EXPECT_THAT(Annotate({.caption = "\xff\xfe"}, Orthographic(100, 240), Plain(320, 240)).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("UTF-8")));
}

}  // namespace
}  // namespace isoscope::cli
