#include "clients/cpp/picture_file/annotations.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/picture/color_map.h"
#include "tests/support/status_matchers.h"

namespace isoscope::client {
namespace {

using ::isoscope::testing::IsOk;
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
  Annotations flags{.has_axes = true, .has_scale_bar = true, .caption = "Two\\nlines"};
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
  const Annotations flags{.has_axes = true, .caption = "at {isovalue}"};
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
  const Annotations flags{.has_scale_bar = true};
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
  const Annotations flags{
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

// Repeats a text.
std::string Times(int count, const std::string& text) {
  std::string repeated;
  for (int i = 0; i < count; ++i) {
    repeated += text;
  }
  return repeated;
}

// Symptom: the sheet was as high as all lines, and Cairo refused it, or took gigabytes.
TEST(AnnotationsTest, LinesBelowThePictureAreLeftOut) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const Annotated some,
      Annotate({.caption = Times(20, "a\\n")}, Orthographic(100, 100), Plain(120, 100)));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const Annotated many,
      Annotate({.caption = Times(5000, "a\\n")}, Orthographic(100, 100), Plain(120, 100)));
  EXPECT_TRUE(many.picture.pixels == some.picture.pixels);
}

TEST(AnnotationsTest, ACaptionThatIsovaluesMakeTooLongIsRefusedBeforeItIsMade) {
  AnnotationScene scene = Orthographic(100, 240);
  scene.label_names = {std::string(1000, 'a')};
  ISOSCOPE_EXPECT_OK(Annotate({.caption = "{isovalue}"}, scene, Plain(320, 240)).status());
  EXPECT_THAT(Annotate({.caption = Times(17, "{isovalue}")}, scene, Plain(320, 240)).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("17170 bytes")));
}

// Returns how many pixels of a plain picture a caption touches.
std::ptrdiff_t InkOf(const std::string& caption) {
  const absl::StatusOr<Annotated> annotated =
      Annotate({.caption = caption}, Orthographic(100, 240), Plain(320, 240));
  EXPECT_THAT(annotated, IsOk());
  const image::RgbaImage plain = Plain(320, 240);
  return annotated.ok()
             ? std::count_if(
                   annotated->picture.pixels.begin(), annotated->picture.pixels.end(),
                   [&](const image::Rgba8& pixel) { return !(pixel == plain.pixels.front()); })
             : 0;
}

// Symptom: Cairo's toy text joined no letters and wrote Arabic from left to right.
TEST(AnnotationsTest, CaptionsAreShapedAsTheirScriptWants) {
  // Two Arabic letters side by side are joined, which takes less ink than each alone.
  EXPECT_LT(InkOf("\u0628\u0628"), InkOf("\u0628 \u0628"));
  // A combining accent lies on its letter and does not make the line longer.
  const auto width_of = [](const std::string& caption) {
    const absl::StatusOr<Annotated> annotated =
        Annotate({.caption = caption}, Orthographic(100, 240), Plain(320, 240));
    EXPECT_THAT(annotated, IsOk());
    return annotated.ok() && !annotated->boxes.empty()
               ? annotated->boxes.front().end_x - annotated->boxes.front().begin_x
               : 0;
  };
  EXPECT_EQ(width_of("e\u0301e"), width_of("\u00e9e"));
  for (const char* caption :
       {"\u0431\u043b\u043e\u043a", "\u05e9\u05dc\u05d5\u05dd", "\u03c3 = 60"}) {
    EXPECT_GT(InkOf(caption), 50) << caption;
  }
}

TEST(AnnotationsTest, LegendTicksAreRoundNumbersInTheRange) {
  EXPECT_THAT(LegendTicks({0, 1}, 5), ::testing::ElementsAre(0, 0.5, 1));
  EXPECT_THAT(LegendTicks({0, 1}, 6),
              ::testing::Pointwise(::testing::DoubleNear(1e-12), {0.0, 0.2, 0.4, 0.6, 0.8, 1.0}));
  EXPECT_THAT(LegendTicks({-7, 23}, 4), ::testing::ElementsAre(0, 10, 20));
  EXPECT_THAT(LegendTicks({101, 104}, 8),
              ::testing::Pointwise(::testing::DoubleNear(1e-9),
                                   {101.0, 101.5, 102.0, 102.5, 103.0, 103.5, 104.0}));
  for (const frame::ColorRange& range :
       {frame::ColorRange{1e18, 1e18 + 1024}, frame::ColorRange{-1e-300, 1e-300},
        frame::ColorRange{0, 5e-324}, frame::ColorRange{-8e307, 8e307},
        frame::ColorRange{0.1, 0.1 + 1e-15}}) {
    const std::vector<double> ticks = LegendTicks(range, 8);
    EXPECT_LE(ticks.size(), 8U) << range.min;
    for (const double value : ticks) {
      EXPECT_GE(value, range.min);
      EXPECT_LE(value, range.max);
    }
  }
}

TEST(AnnotationsTest, NeighbouringTicksHaveDifferentTextsFarFromZero) {
  EXPECT_EQ(TickLabel(0.5, 0.5), "0.5");
  EXPECT_EQ(TickLabel(4600000.02, 0.01), "4600000.02");
  EXPECT_EQ(TickLabel(-500000.002, 0.002), "-500000.002");
  EXPECT_EQ(TickLabel(1000.000002, 1e-6), "1000.000002");
  EXPECT_EQ(TickLabel(1e-20, 0.1), "0") << "the rounding of a tick at zero";
  EXPECT_EQ(TickLabel(0.1 + 0.2, 0.1), "0.3");
  EXPECT_NE(TickLabel(1e18, 128), TickLabel(1e18 + 128, 128));
  EXPECT_EQ(TickLabel(std::nextafter(1.0, 2.0), 1e-18), "1.0000000000000002") << "it ends";
}

// The bar is somewhere in the right half: its first and last colours are there, from bottom to top.
TEST(AnnotationsTest, TheLegendShowsTheMapFromBottomToTop) {
  AnnotationScene scene = Orthographic(500, 400);
  scene.colorings = {{.surface_index = 0,
                      .color_by = {.quantity = frame::ColorBy::Quantity::kPositionZ,
                                   .map = frame::ColorMap::kTurbo,
                                   .range = frame::ColorRange{0, 10}}}};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Annotated annotated,
                                Annotate({.has_legend = true}, scene, Plain(600, 400)));
  const image::RgbaImage& picture = annotated.picture;
  const auto row_of = [&](const image::Rgba8& color) {
    for (int y = 0; y < picture.height; ++y) {
      for (int x = picture.width / 2; x < picture.width; ++x) {
        if (picture.pixels[static_cast<std::size_t>(y * picture.width + x)] == color) {
          EXPECT_TRUE(IsInside(annotated.boxes, x, y));
          return y;
        }
      }
    }
    return -1;
  };
  const picture::ColorMapTable& table = picture::ColorMapTableOf(frame::ColorMap::kTurbo);
  const int bottom = row_of(table.front());
  const int middle = row_of(table[130]);
  const int top = row_of(table.back());
  ASSERT_GE(top, 0);
  EXPECT_LT(top, middle);
  EXPECT_LT(middle, bottom);
  EXPECT_NEAR(bottom - top, 0.45 * 400, 6);
}

// Returns the boxes of a colour's pixels, exactly that colour; empty if there are none.
view::PixelRect BoxOf(const image::RgbaImage& picture, const image::Rgba8& color) {
  view::PixelRect box{picture.width, picture.height, 0, 0};
  for (int y = 0; y < picture.height; ++y) {
    for (int x = 0; x < picture.width; ++x) {
      if (picture.pixels[static_cast<std::size_t>(y * picture.width + x)] == color) {
        box = {std::min(box.begin_x, x), std::min(box.begin_y, y), std::max(box.end_x, x + 1),
               std::max(box.end_y, y + 1)};
      }
    }
  }
  return box;
}

AnnotationScene ColoredByField() {
  AnnotationScene scene = Orthographic(500, 400);
  scene.colorings = {{.surface_index = 0,
                      .color_by = {.quantity = frame::ColorBy::Quantity::kField,
                                   .map = frame::ColorMap::kTurbo,
                                   .range = frame::ColorRange{0, 10}},
                      .field_title = "temperature, K"}};
  return scene;
}

TEST(AnnotationsTest, ASwatchBelowTheBarShowsTheColorOfMissingValues) {
  constexpr image::Rgba8 kMissing{200, 0, 200, 255};  // no mixture of letters and outlines
  AnnotationScene scene = ColoredByField();
  const Annotations flags{.has_legend = true};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Annotated plain, Annotate(flags, scene, Plain(600, 400)));
  scene.colorings[0].nan_color = kMissing;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Annotated annotated, Annotate(flags, scene, Plain(600, 400)));
  const view::PixelRect swatch = BoxOf(annotated.picture, kMissing);
  ASSERT_FALSE(swatch.empty());
  EXPECT_EQ(swatch.end_x - swatch.begin_x, 11) << "the least height of text";
  EXPECT_EQ(swatch.end_y - swatch.begin_y, 11);
  const image::Rgba8& least = picture::ColorMapTableOf(frame::ColorMap::kTurbo).front();
  const view::PixelRect bar = BoxOf(annotated.picture, least);
  EXPECT_EQ(swatch.begin_x, bar.begin_x) << "a tick covers the other end of the bar's row";
  EXPECT_GT(swatch.begin_y, bar.end_y);
  // The bar stays where it is, and the words stand beside the swatch.
  EXPECT_EQ(BoxOf(plain.picture, least), bar);
  EXPECT_TRUE(BoxOf(plain.picture, kMissing).empty());
  int ink_beside = 0;
  for (int y = swatch.begin_y; y < swatch.end_y; ++y) {
    for (int x = swatch.end_x + 4; x < 600; ++x) {
      ink_beside += annotated.picture.pixels[static_cast<std::size_t>(y * 600 + x)].r > 100 ? 1 : 0;
    }
  }
  EXPECT_GT(ink_beside, 20);
}

TEST(AnnotationsTest, CapsThatShowSamplesHaveABarOfTheirOwn) {
  const Annotations flags{.has_legend = true};
  AnnotationScene scene = Orthographic(500, 400);
  scene.caps_coloring = {
      .map = frame::ColorMap::kViridis, .range = {3, 7}, .title = "samples on cuts"};
  const image::Rgba8& caps_color = picture::ColorMapTableOf(frame::ColorMap::kViridis).back();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Annotated alone, Annotate(flags, scene, Plain(600, 400)));
  EXPECT_FALSE(BoxOf(alone.picture, caps_color).empty());
  scene.colorings = ColoredByField().colorings;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Annotated both, Annotate(flags, scene, Plain(600, 400)));
  const view::PixelRect surface_box =
      BoxOf(both.picture, picture::ColorMapTableOf(frame::ColorMap::kTurbo).back());
  ASSERT_FALSE(surface_box.empty());
  EXPECT_LT(BoxOf(both.picture, caps_color).end_x, surface_box.begin_x) << "side by side";
  EXPECT_EQ(both.boxes.size(), 2U);
}

// Symptom: bars that did not fit beside each other were drawn beyond the left side.
TEST(AnnotationsTest, BarsThatDoNotFitInOneRowGetSeveral) {
  AnnotationScene scene = Orthographic(500, 400);
  scene.isovalues.assign(9, 1);
  for (std::size_t i = 0; i < 9; ++i) {
    scene.colorings.push_back(
        {.surface_index = i,
         .color_by = {.quantity = frame::ColorBy::Quantity::kField,
                      .map = frame::ColorMap::kTurbo,
                      .range = frame::ColorRange{0, 1.0 + static_cast<double>(i)}},
         .field_title = "a field with a long title"});
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Annotated annotated,
                                Annotate({.has_legend = true}, scene, Plain(640, 480)));
  ASSERT_EQ(annotated.boxes.size(), 9U);
  for (std::size_t i = 0; i < 9; ++i) {
    const view::PixelRect& box = annotated.boxes[i];
    EXPECT_GE(box.begin_x, 0) << i;
    EXPECT_GE(box.begin_y, 0) << i;
    EXPECT_LE(box.end_x, 640) << i;
    EXPECT_LE(box.end_y, 480) << i;
    EXPECT_GT(box.end_x - box.begin_x, 60) << i;
    EXPECT_GT(box.end_y - box.begin_y, 40) << i;
  }
}

// Symptom: the bar lay left of the picture, or Cairo refused the sheet.
TEST(AnnotationsTest, ABarIsInThePictureHoweverLongItsTitleIs) {
  AnnotationScene scene = ColoredByField();
  scene.isovalues = {1, 2};
  scene.label_names = {std::string(100'000, 'W'), "b"};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Annotated annotated,
                                Annotate({.has_legend = true}, scene, Plain(600, 400)));
  const view::PixelRect bar =
      BoxOf(annotated.picture, picture::ColorMapTableOf(frame::ColorMap::kTurbo).front());
  ASSERT_FALSE(bar.empty());
  EXPECT_EQ(bar.begin_x, 6) << "half a letter from the side";
}

TEST(AnnotationsTest, ALegendNeedsASurfaceThatShowsAQuantity) {
  EXPECT_THAT(Annotate({.has_legend = true}, Orthographic(500, 400), Plain(100, 100)),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("--color-by")));
}

TEST(AnnotationsTest, LegendsOfAnySizeAndNumberAreDrawn) {
  AnnotationScene scene = Orthographic(500, 400);
  scene.isovalues = {1, 2, 3, 4, 5};
  for (std::size_t i = 0; i < 5; ++i) {
    scene.colorings.push_back(
        {.surface_index = i,
         .color_by = {.quantity = static_cast<frame::ColorBy::Quantity>(i % 4),
                      .map = frame::ColorMap::kGrey,
                      .range = frame::ColorRange{-1e-30, 1e30 * static_cast<double>(i + 1)}}});
  }
  for (const int side : {1, 7, 60, 900}) {
    ISOSCOPE_ASSERT_OK(Annotate({.has_legend = true}, scene, Plain(side, side)).status());
  }
}

// Seen along z, the patient's axes have one letter less than seen askew.
TEST(AnnotationsTest, AnAxisAlongTheViewShowsTheEndThatPointsToTheEye) {
  const auto blue_count = [](const math::Vec3d& eye, bool has_patient) {
    AnnotationScene scene = Orthographic(500, 400);
    scene.camera.eye = eye;
    if (has_patient) {
      NameAxes(volume::PatientFrame(), &scene);
    }
    const absl::StatusOr<Annotated> annotated =
        Annotate({.has_axes = true}, scene, Plain(400, 400));
    EXPECT_THAT(annotated, ::isoscope::testing::IsOk());
    return std::count_if(
        annotated->picture.pixels.begin(), annotated->picture.pixels.end(),
        [](const image::Rgba8& pixel) { return pixel.b > 150 && pixel.b > 2 * pixel.r; });
  };
  const auto along = blue_count({0, 0, 10}, true);
  EXPECT_GT(along, 5) << "S, which points to the eye, is missing";
  EXPECT_GT(blue_count({10, 0, 0.1}, true), 3 * along) << "both arms and both letters show";
  EXPECT_GT(blue_count({0, 0, 10}, false), 5);
}

TEST(AnnotationsTest, AxesOfAPatientHaveTheLettersOfItsSides) {
  AnnotationScene scene;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::PatientFrame frame,
                                volume::PatientFrame::FromName("RAS"));
  NameAxes(frame, &scene);
  EXPECT_THAT(scene.axis_names, ::testing::ElementsAre("R", "A", "S"));
  EXPECT_THAT(scene.opposite_names, ::testing::ElementsAre("L", "P", "I"));
  NameAxes(volume::PatientFrame(), &scene);
  EXPECT_THAT(scene.axis_names, ::testing::ElementsAre("L", "P", "S"));
  EXPECT_THAT(scene.opposite_names, ::testing::ElementsAre("R", "A", "I"));
}

}  // namespace
}  // namespace isoscope::client
