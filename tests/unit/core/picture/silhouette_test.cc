#include "core/picture/silhouette.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include <oneapi/tbb/task_arena.h>

#include "core/base/random.h"
#include "tests/unit/core/picture/depth_scene.h"

namespace isoscope::picture {
namespace {

using image::FrameImage;
using image::Rgba8;

constexpr Rgba8 kLine{255, 0, 0, 255};
constexpr image::FragmentOrder kOrder{.block_count = kSceneBlocks};

FrameImage Draw(FrameImage image, const view::View& view, int width_px, int samples_per_side = 1) {
  DrawSilhouettes({.width_px = width_px, .color = kLine}, view, kOrder, samples_per_side, &image);
  return image;
}

// A row of the picture: '#' for a line, '.' for the surface, ' ' for the background.
std::string RowOf(const FrameImage& image, int y) {
  std::string row;
  for (int x = 0; x < image.width; ++x) {
    const Rgba8 color = image.colors[image.IndexOf(x, y)];
    row += color == kLine ? '#' : color.a == 0 ? ' ' : '.';
  }
  return row;
}

view::View RowView(int width) { return MakeSceneView({width, 9}, view::Projection::kOrthographic); }

// The same in all rows.
FrameImage RowsOf(const view::View& view, const std::vector<std::optional<double>>& distances,
                  const std::vector<std::uint32_t>& surfaces = {}) {
  return DrawScene(view, [&](int x, int /*y*/) -> std::optional<ScenePoint> {
    const auto i = static_cast<std::size_t>(x);
    if (!distances[i].has_value()) {
      return std::nullopt;
    }
    return ScenePoint{.depth = DepthOfDistance(
                          view, 0.5 * (view.near_distance() + view.far_distance()) + *distances[i]),
                      .surface = surfaces.empty() ? 0 : surfaces[i]};
  });
}

TEST(SilhouetteTest, ALineLiesInsideTheSurfaceThatTheBackgroundEnds) {
  const view::View view = RowView(12);
  const std::optional<double> none;
  const FrameImage image = RowsOf(view, {none, none, 0, 0, 0, 0, 0, 0, 0, none, none, none});
  EXPECT_EQ(RowOf(Draw(image, view, 1), 4), "  #.....#   ");
  EXPECT_EQ(RowOf(Draw(image, view, 2), 4), "  ##...##   ");
  EXPECT_EQ(RowOf(Draw(image, view, 16), 4), "  #######   ");
  EXPECT_EQ(Draw(image, view, 2).keys, image.keys);
}

TEST(SilhouetteTest, ALineLiesOnTheNearerSideOfAJump) {
  const view::View view = RowView(10);
  const FrameImage image = RowsOf(view, {0, 0, 0, 0, 0, 30, 30, 30, 30, 30});
  EXPECT_EQ(RowOf(Draw(image, view, 2), 4), "...##.....");
  // 1.5 % of the 120 units that the viewport shows are 1.8.
  EXPECT_EQ(RowOf(Draw(RowsOf(view, {0, 0, 0, 0, 0, 1.7, 1.7, 1.7, 1.7, 1.7}), view, 2), 4),
            "..........");
  EXPECT_EQ(RowOf(Draw(RowsOf(view, {0, 0, 0, 0, 0, 1.9, 1.9, 1.9, 1.9, 1.9}), view, 2), 4),
            "...##.....");
}

TEST(SilhouetteTest, ASteepSlopeIsNoJump) {
  const view::View view = RowView(10);
  EXPECT_EQ(RowOf(Draw(RowsOf(view, {-36, -28, -20, -12, -4, 4, 12, 20, 28, 36}), view, 2), 4),
            "..........");
  // But a jump on a slope is one.
  EXPECT_EQ(RowOf(Draw(RowsOf(view, {-12, -9, -6, -3, 0, 20, 23, 26, 29, 32}), view, 1), 4),
            "....#.....");
}

TEST(SilhouetteTest, WhereSurfacesMeetTheNearerOneGetsTheLine) {
  const view::View view = RowView(8);
  EXPECT_EQ(
      RowOf(Draw(RowsOf(view, {1, 1, 1, 1, 0.5, 0.5, 0.5, 0.5}, {0, 0, 0, 0, 3, 3, 3, 3}), view, 2),
            4),
      "....##..");
  // At the same depth the earlier surface gets it.
  EXPECT_EQ(
      RowOf(Draw(RowsOf(view, {0, 0, 0, 0, 0, 0, 0, 0}, {2, 2, 2, 2, 1, 1, 1, 1}), view, 1), 4),
      "....#...");
}

TEST(SilhouetteTest, TheBorderOfTheViewportIsNoEdge) {
  const view::View view = RowView(8);
  EXPECT_EQ(RowOf(Draw(RowsOf(view, {0, 0, 0, 0, 0, 0, 0, 0}), view, 4), 0), "........");
}

TEST(SilhouetteTest, SamplesKeepTheWidthInPixelsOfThePicture) {
  const view::View view = RowView(12);
  const std::optional<double> none;
  const FrameImage image = RowsOf(view, {none, none, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0});
  EXPECT_EQ(RowOf(Draw(image, view, 1, 4), 4), "  ####......");
  EXPECT_EQ(RowOf(Draw(image, view, 2, 3), 4), "  ######....");
}

TEST(SilhouetteTest, ADiscHasARingOfTheWidth) {
  const view::View view = MakeSceneView({100, 100}, view::Projection::kPerspective);
  const auto radius_at = [](int x, int y) { return std::hypot(x - 49.5, y - 49.5); };
  const FrameImage image = DrawScene(view, [&](int x, int y) -> std::optional<ScenePoint> {
    return radius_at(x, y) < 40 ? std::optional<ScenePoint>(ScenePoint()) : std::nullopt;
  });
  const FrameImage drawn = Draw(image, view, 5);
  for (int y = 0; y < 100; ++y) {
    for (int x = 0; x < 100; ++x) {
      const Rgba8 color = drawn.colors[drawn.IndexOf(x, y)];
      const double radius = radius_at(x, y);
      if (radius >= 40) {
        ASSERT_EQ(color.a, 0);
      } else if (radius > 36.5) {
        ASSERT_EQ(color, kLine) << x << ", " << y;
      } else if (radius < 34) {
        ASSERT_NE(color, kLine) << x << ", " << y;
      }
    }
  }
}

// Squares of several surfaces at random depths, and background.
Scene Squares(const view::View& view) {
  return [&view](int x, int y) -> std::optional<ScenePoint> {
    const int cell = (y / 17) * 100 + x / 23;
    const double dice = base::RandomUnit(8, static_cast<std::uint64_t>(cell));
    if (dice < 0.2) {
      return std::nullopt;
    }
    const double distance = view.near_distance() +
                            dice * (view.far_distance() - view.near_distance()) * 0.8 +
                            0.2 * (x % 23);
    return ScenePoint{.depth = DepthOfDistance(view, distance),
                      .surface = static_cast<std::uint32_t>(cell % 3)};
  };
}

TEST(SilhouetteTest, ARegionWithItsMarginHasTheWholesPixels) {
  for (const int s : {1, 2, 4}) {
    for (const int width_px : {1, 3, 16}) {
      const view::Viewport viewport{160 * s, 140 * s};
      const view::View view = MakeSceneView(viewport, view::Projection::kPerspective);
      const Scene scene = Squares(view);
      const FrameImage whole = Draw(DrawScene(view, scene), view, width_px, s);
      for (std::uint64_t seed = 0; seed < 8; ++seed) {
        const auto random = [&](int counter, int limit) {
          return static_cast<int>(limit *
                                  base::RandomUnit(seed, static_cast<std::uint64_t>(counter)));
        };
        const int x = random(0, 160);
        const int y = random(1, 140);
        const int width = 1 + random(2, 160 - x);
        const int height = 1 + random(3, 140 - y);
        const int margin = width_px + frame::Silhouette::kBorderPx;
        const int begin_x = std::max(x - margin, 0);
        const int begin_y = std::max(y - margin, 0);
        const view::Region region{begin_x * s, begin_y * s,
                                  (std::min(x + width + margin, 160) - begin_x) * s,
                                  (std::min(y + height + margin, 140) - begin_y) * s};
        const view::View part_view =
            MakeSceneView(viewport, view::Projection::kPerspective, region);
        const FrameImage part = Draw(DrawScene(part_view, scene), part_view, width_px, s);
        for (int row = y * s; row < (y + height) * s; ++row) {
          for (int column = x * s; column < (x + width) * s; ++column) {
            ASSERT_EQ(part.colors[part.IndexOf(column - region.x, row - region.y)],
                      whole.colors[whole.IndexOf(column, row)])
                << "pixel " << column << ", " << row << ", seed " << seed;
          }
        }
      }
    }
  }
}

TEST(SilhouetteTest, ThreadsDoNotShow) {
  const view::View view = MakeSceneView({300, 400}, view::Projection::kPerspective);
  const FrameImage image = DrawScene(view, Squares(view));
  const FrameImage expected = Draw(image, view, 3);
  EXPECT_FALSE(expected == image);
  for (const int threads : {1, 3}) {
    tbb::task_arena(threads).execute(
        [&] { EXPECT_TRUE(Draw(image, view, 3) == expected) << threads; });
  }
}

}  // namespace
}  // namespace isoscope::picture
