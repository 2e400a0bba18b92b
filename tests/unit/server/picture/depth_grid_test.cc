#include "server/picture/depth_grid.h"

#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/view/unprojection.h"
#include "tests/support/status_matchers.h"

namespace isoscope::server {
namespace {

view::View MakeView(int width, int height) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {20, 20, 20};
  auto view =
      view::View::Make(view::MakeDefaultCamera(geometry.Bounds()), {width, height}, geometry);
  ISOSCOPE_EXPECT_OK(view);
  return *view;
}

std::uint16_t ValueAt(const DepthGrid& grid, int i, int j) {
  return base::LoadLittleEndian<std::uint16_t>(
      grid.depths.data() + 2 * (static_cast<std::size_t>(j) * static_cast<std::size_t>(grid.width) +
                                static_cast<std::size_t>(i)));
}

TEST(DepthGridTest, APictureWithoutSurfaceIsAllBackground) {
  const DepthGrid grid = MakeDepthGrid(image::FrameImage(64, 48), MakeView(64, 48), 16);
  EXPECT_EQ(grid.width, 16);
  EXPECT_EQ(grid.height, 12);
  ASSERT_EQ(grid.depths.size(), std::size_t{2} * 16 * 12);
  EXPECT_EQ(grid.near_distance, 0);
  EXPECT_EQ(grid.far_distance, 0);
  for (int j = 0; j < 12; ++j) {
    for (int i = 0; i < 16; ++i) {
      EXPECT_EQ(ValueAt(grid, i, j), kGridBackground);
    }
  }
}

TEST(DepthGridTest, ValuesGoLinearlyFromTheNearestToTheFarthestDistance) {
  constexpr int kWidth = 60;
  constexpr int kHeight = 30;
  image::FrameImage image(kWidth, kHeight);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth - 6; ++x) {
      image.Set(x, y, image::FragmentKey(static_cast<float>(x + 1) / 64, 3), {1, 2, 3, 255});
    }
  }
  const view::View view = MakeView(kWidth, kHeight);
  const view::Unprojection unprojection(view);
  const DepthGrid grid = MakeDepthGrid(image, view, 20);
  ASSERT_EQ(grid.width, 20);
  ASSERT_EQ(grid.height, 10);
  // Point i is seen in the middle of pixels 3 i .. 3 i + 2.
  EXPECT_FLOAT_EQ(static_cast<float>(grid.near_distance), unprojection.DistanceOf(2.0F / 64));
  for (int i = 0; i < 18; ++i) {
    const double distance = unprojection.DistanceOf(static_cast<float>(3 * i + 2) / 64);
    const double step = (grid.far_distance - grid.near_distance) / 65534;
    EXPECT_NEAR(grid.near_distance + ValueAt(grid, i, 5) * step, distance, step) << i;
  }
  EXPECT_EQ(ValueAt(grid, 0, 0), 0);
  EXPECT_EQ(ValueAt(grid, 17, 9), 65534);
  EXPECT_EQ(ValueAt(grid, 18, 0), kGridBackground);
}

TEST(DepthGridTest, NarrowAndTinyPicturesHaveAPointForEachPixelAtMost) {
  for (const auto& [width, height, points_x, points_y] :
       {std::tuple{1, 1, 1, 1}, {3, 1, 3, 1}, {1000, 1, 128, 1}, {100, 200, 64, 128}}) {
    const DepthGrid grid =
        MakeDepthGrid(image::FrameImage(width, height), MakeView(width, height), 128);
    EXPECT_EQ(grid.width, points_x);
    EXPECT_EQ(grid.height, points_y);
  }
}

// The pixels of one band alone decide neither the nearest nor the farthest distance.
TEST(DepthGridTest, BandsGiveTheGridOfTheWhole) {
  constexpr int kWidth = 50;
  constexpr int kHeight = 40;
  image::FrameImage image(kWidth, kHeight);
  for (int y = 3; y < kHeight; ++y) {
    for (int x = 0; x < kWidth - 5; ++x) {
      image.Set(x, y, image::FragmentKey(static_cast<float>(x + 3 * y + 1) / 256, 3),
                {1, 2, 3, 255});
    }
  }
  const view::View view = MakeView(kWidth, kHeight);
  const DepthGrid whole = MakeDepthGrid(image, view, 16);
  constexpr int kMargin = 2;
  DepthGridBuilder builder({kWidth, kHeight}, 16);
  for (const view::Region& band :
       {view::Region{0, 0, 20, 17}, {20, 0, 30, 17}, {0, 17, 20, 23}, {20, 17, 30, 23}}) {
    image::FrameImage part(band.width_px + kMargin, band.height_px + kMargin);
    for (int y = 0; y < band.height_px; ++y) {
      for (int x = 0; x < band.width_px; ++x) {
        const std::uint64_t key = image.keys[image.IndexOf(band.x + x, band.y + y)];
        if (key != image::kBackgroundKey) {
          part.Set(kMargin + x, kMargin + y, key, {1, 2, 3, 255});
        }
      }
    }
    builder.Add(band, part, view, kMargin, kMargin);
  }
  const DepthGrid joined = builder.Make();
  EXPECT_EQ(joined.width, whole.width);
  EXPECT_EQ(joined.height, whole.height);
  EXPECT_EQ(joined.near_distance, whole.near_distance);
  EXPECT_EQ(joined.far_distance, whole.far_distance);
  EXPECT_EQ(joined.depths, whole.depths);
}

TEST(DepthGridTest, OneDepthIsTheValueZero) {
  image::FrameImage image(4, 4);
  image.Set(1, 1, image::FragmentKey(0.5F, 3), {1, 2, 3, 255});
  const DepthGrid grid = MakeDepthGrid(image, MakeView(4, 4), 4);
  EXPECT_EQ(grid.near_distance, grid.far_distance);
  EXPECT_EQ(ValueAt(grid, 1, 1), 0);
  EXPECT_EQ(ValueAt(grid, 2, 1), kGridBackground);
}

}  // namespace
}  // namespace isoscope::server
