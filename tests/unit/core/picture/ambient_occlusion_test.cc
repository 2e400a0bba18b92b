// Scenes made of depths (depth_scene.h) whose occlusion is known:
//
// - surfaces that must stay as they are: planes, balls, walls far in front;
// - surfaces that must get darker, and where: corners and steps;
// - the picture does not depend on regions, threads, instruction sets or samples;
// - extreme images and views.

#include "core/picture/ambient_occlusion.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "gtest/gtest.h"
#include <oneapi/tbb/task_arena.h>

#include "core/base/random.h"
#include "hwy/targets.h"
#include "tests/unit/core/picture/depth_scene.h"

namespace isoscope::picture {
namespace {

using image::FrameImage;
using image::Rgba8;

constexpr view::Projection kProjections[] = {view::Projection::kPerspective,
                                             view::Projection::kOrthographic};

FrameImage Shade(FrameImage image, const view::View& view, int radius_px, float strength = 1,
                 int samples_per_side = 1) {
  ShadeAmbientOcclusion({.radius_px = radius_px, .strength = strength}, view, samples_per_side,
                        &image);
  return image;
}

// Returns the decrease of the red of a pixel.
int DarkeningAt(const FrameImage& before, const FrameImage& after, int x, int y) {
  const std::size_t i = before.IndexOf(x, y);
  return before.colors[i].r - after.colors[i].r;
}

double MiddleDistance(const view::View& view) {
  return 0.5 * (view.near_distance() + view.far_distance());
}

TEST(AmbientOcclusionTest, APlaneHidesNothingFromItselfHoweverItIsTilted) {
  for (const view::Projection projection : kProjections) {
    const view::View view = MakeSceneView({160, 120}, projection);
    for (const math::Vec3d& normal : {math::Vec3d{0, 0, -1}, math::Vec3d{0.8, 0, -0.6},
                                      math::Vec3d{-0.3, 0.9, -0.4}, math::Vec3d{0.7, -0.7, -0.2}}) {
      const FrameImage image = DrawScene(view, [&](int x, int y) -> std::optional<ScenePoint> {
        const double distance = DistanceToPlane(view, x, y, {0, 0, MiddleDistance(view)}, normal);
        if (!(distance > view.near_distance() && distance < view.far_distance())) {
          return std::nullopt;
        }
        return ScenePoint{.depth = DepthOfDistance(view, distance)};
      });
      EXPECT_TRUE(Shade(image, view, 32) == image)
          << normal.x << ", " << normal.y << ", " << normal.z;
    }
  }
}

TEST(AmbientOcclusionTest, ABallHidesNothingFromItself) {
  const view::View view = MakeSceneView({200, 200}, view::Projection::kOrthographic);
  const FrameImage image = DrawScene(view, [&](int x, int y) -> std::optional<ScenePoint> {
    const double r2 = (x - 99.5) * (x - 99.5) + (y - 99.5) * (y - 99.5);
    if (r2 > 70 * 70) {
      return std::nullopt;
    }
    const double rise = std::sqrt(70 * 70 - r2) * 120 / 200;
    return ScenePoint{.depth = DepthOfDistance(view, MiddleDistance(view) - rise)};
  });
  EXPECT_TRUE(Shade(image, view, 40) == image);
}

// Two planes that meet at a right angle in the column in the middle, open to the eye.
Scene Corner(const view::View& view) {
  return [&view](int x, int y) -> std::optional<ScenePoint> {
    const double middle = 0.5 * view.viewport().width_px;
    const double side = x + 0.5 < middle ? 1 : -1;
    return ScenePoint{
        .depth = DepthOfDistance(
            view, DistanceToPlane(view, x, y, {0, 0, MiddleDistance(view)}, {side, 0, -1}))};
  };
}

TEST(AmbientOcclusionTest, ACornerIsDarkestWhereItsWallsMeetAndOnBothSidesAlike) {
  for (const view::Projection projection : kProjections) {
    const view::View view = MakeSceneView({200, 120}, projection);
    const FrameImage image = DrawScene(view, Corner(view));
    const FrameImage shaded = Shade(image, view, 32);
    const auto at = [&](int x) { return DarkeningAt(image, shaded, x, 60); };
    EXPECT_GT(at(98), 20);
    EXPECT_GT(at(98), at(90));
    EXPECT_GT(at(90), at(75));
    EXPECT_EQ(at(50), 0) << "farther than the radius";
    for (int distance = 2; distance < 30; ++distance) {
      EXPECT_NEAR(at(100 - distance - 1), at(100 + distance), 10) << distance;
    }
  }
}

TEST(AmbientOcclusionTest, AStepDarkensItsFootAndNotItsTop) {
  const view::View view = MakeSceneView({200, 120}, view::Projection::kPerspective);
  const double middle = MiddleDistance(view);
  const FrameImage image = DrawScene(view, [&](int x, int /*y*/) {
    return ScenePoint{.depth = DepthOfDistance(view, x < 100 ? middle - 12 : middle)};
  });
  const FrameImage shaded = Shade(image, view, 32);
  for (int x = 0; x < 99; ++x) {
    EXPECT_EQ(DarkeningAt(image, shaded, x, 60), 0) << x;
  }
  EXPECT_GT(DarkeningAt(image, shaded, 101, 60), 10) << "the foot begins right at the step";
  EXPECT_GT(DarkeningAt(image, shaded, 101, 60), DarkeningAt(image, shaded, 115, 60));
  EXPECT_EQ(DarkeningAt(image, shaded, 140, 60), 0);
}

TEST(AmbientOcclusionTest, AWallFarInFrontCastsNoHalo) {
  const view::View view = MakeSceneView({200, 120}, view::Projection::kPerspective);
  const FrameImage image = DrawScene(view, [&](int x, int /*y*/) {
    return ScenePoint{.depth = DepthOfDistance(
                          view, x < 100 ? view.near_distance() + 5 : view.far_distance() - 5)};
  });
  EXPECT_TRUE(Shade(image, view, 16) == image);
}

TEST(AmbientOcclusionTest, StrengthIsTheShareOfLightThatGoes) {
  const view::View view = MakeSceneView({200, 120}, view::Projection::kOrthographic);
  const FrameImage image = DrawScene(view, Corner(view));
  EXPECT_TRUE(Shade(image, view, 32, 0) == image);
  const FrameImage half = Shade(image, view, 32, 0.5F);
  const FrameImage full = Shade(image, view, 32, 1);
  EXPECT_GT(DarkeningAt(image, half, 98, 60), 5);
  EXPECT_GT(DarkeningAt(image, full, 98, 60), DarkeningAt(image, half, 98, 60) * 3 / 2);
  EXPECT_EQ(full.keys, image.keys);
}

// Bumps, holes, thin bars and background.
Scene Landscape(const view::View& view) {
  return [&view](int x, int y) -> std::optional<ScenePoint> {
    const double scale = 200.0 / view.viewport().width_px;
    const double u = (x + 0.5) * scale;
    const double v = (y + 0.5) * scale;
    if (std::hypot(u - 150, v - 40) < 25) {
      return std::nullopt;
    }
    double distance = MiddleDistance(view) + 6 * std::sin(u / 7) * std::cos(v / 9) + 0.1 * u;
    if (static_cast<int>(u / 11) % 3 == 0 && static_cast<int>(v / 5) % 4 == 0) {
      distance -= 15;
    }
    return ScenePoint{.depth = DepthOfDistance(view, distance),
                      .surface = 0,
                      .color = {static_cast<std::uint8_t>(100 + u / 2),
                                static_cast<std::uint8_t>(200 - v), 90, 255}};
  };
}

TEST(AmbientOcclusionTest, ARegionWithItsMarginHasTheWholesPixels) {
  for (const view::Projection projection : kProjections) {
    for (const int samples_per_side : {1, 2, 3, 4}) {
      const int s = samples_per_side;
      const view::Viewport viewport{203 * s, 151 * s};
      const view::View view = MakeSceneView(viewport, projection);
      const Scene scene = Landscape(view);
      const FrameImage whole = Shade(DrawScene(view, scene), view, 20, 1, s);
      for (std::uint64_t seed = 0; seed < 12; ++seed) {
        const auto random = [&](int counter, int limit) {
          return static_cast<int>(limit *
                                  base::RandomUnit(seed, static_cast<std::uint64_t>(counter)));
        };
        const int x = random(0, 203);
        const int y = random(1, 151);
        const int width = 1 + random(2, 203 - x);
        const int height = 1 + random(3, 151 - y);
        constexpr int kMargin = 20 + frame::AmbientOcclusion::kBorderPx;
        const int begin_x = std::max(x - kMargin, 0);
        const int begin_y = std::max(y - kMargin, 0);
        const view::Region region{begin_x * s, begin_y * s,
                                  (std::min(x + width + kMargin, 203) - begin_x) * s,
                                  (std::min(y + height + kMargin, 151) - begin_y) * s};
        const view::View part_view = MakeSceneView(viewport, projection, region);
        const FrameImage part = Shade(DrawScene(part_view, scene), part_view, 20, 1, s);
        for (int row = y * s; row < (y + height) * s; ++row) {
          for (int column = x * s; column < (x + width) * s; ++column) {
            ASSERT_EQ(part.colors[part.IndexOf(column - region.x, row - region.y)],
                      whole.colors[whole.IndexOf(column, row)])
                << "pixel " << column << ", " << row << ", seed " << seed << ", " << s;
          }
        }
      }
    }
  }
}

TEST(AmbientOcclusionTest, InstructionSetsAndThreadsDoNotShow) {
  const absl::Cleanup restore = [] { hwy::SetSupportedTargetsForTest(0); };
  for (const view::Projection projection : kProjections) {
    const view::View view = MakeSceneView({333, 222}, projection);
    const FrameImage image = DrawScene(view, Landscape(view));
    const FrameImage expected = Shade(image, view, 30);
    EXPECT_FALSE(expected == image);
    for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
      hwy::SetSupportedTargetsForTest(target);
      EXPECT_TRUE(Shade(image, view, 30) == expected) << hwy::TargetName(target);
    }
    hwy::SetSupportedTargetsForTest(0);
    for (const int threads : {1, 3}) {
      tbb::task_arena(threads).execute(
          [&] { EXPECT_TRUE(Shade(image, view, 30) == expected) << threads; });
    }
  }
}

TEST(AmbientOcclusionTest, SamplesDoNotChangeTheLook) {
  const view::View one_view = MakeSceneView({200, 120}, view::Projection::kPerspective);
  const view::View four_view = MakeSceneView({800, 480}, view::Projection::kPerspective);
  const FrameImage one = DrawScene(one_view, Corner(one_view));
  const FrameImage four = DrawScene(four_view, Corner(four_view));
  const FrameImage one_shaded = Shade(one, one_view, 32);
  const FrameImage four_shaded = Shade(four, four_view, 32, 1, 4);
  for (int x = 60; x < 140; ++x) {
    if (std::abs(x - 100) < 4) {
      continue;  // the light falls steeply to the crease, and pixels are coarser than samples
    }
    EXPECT_NEAR(DarkeningAt(one, one_shaded, x, 60), DarkeningAt(four, four_shaded, 4 * x + 2, 242),
                8)
        << x;
  }
}

TEST(AmbientOcclusionTest, TheSmallestImagesAndLargestRadiusWork) {
  for (const view::Viewport& viewport :
       {view::Viewport{1, 1}, view::Viewport{2, 1}, view::Viewport{1, 300}}) {
    const view::View view = MakeSceneView(viewport, view::Projection::kPerspective);
    const FrameImage image = DrawScene(view, [](int, int) { return ScenePoint(); });
    EXPECT_TRUE(Shade(image, view, frame::AmbientOcclusion::kMaxRadiusPx) == image);
  }
}

// Cameras so near, so far, or so wide that pixels are tiny or huge compared with the volume.
TEST(AmbientOcclusionTest, ExtremeViewsGiveColorsThatAreNoBrighter) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {101, 101, 101};
  for (const double size : {1e-20, 1e-6, 1e9, 1e30}) {
    view::Camera camera = view::MakeDefaultCamera(geometry.Bounds());
    camera.projection = view::Projection::kOrthographic;
    camera.view_height = size;
    auto view = view::View::Make(camera, {64, 64}, geometry);
    if (!view.ok()) {
      continue;
    }
    const FrameImage image = DrawScene(*view, [](int x, int y) {
      return ScenePoint{
          .depth = static_cast<float>(base::RandomUnit(3, static_cast<std::uint64_t>(64 * y + x)))};
    });
    const FrameImage shaded = Shade(image, *view, 56);
    for (std::size_t i = 0; i < image.colors.size(); ++i) {
      ASSERT_LE(shaded.colors[i].r, image.colors[i].r);
    }
  }
}

}  // namespace
}  // namespace isoscope::picture
