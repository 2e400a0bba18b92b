#include "core/picture/covered_pixels.h"

#include <cstddef>
#include <set>
#include <utility>

#include "gtest/gtest.h"

#include "core/image/fragment.h"

namespace isoscope::picture {
namespace {

TEST(CoveredPixelsTest, EachCoveredPixelComesOnceInItsRowOfTiles) {
  image::FrameImage image(70, 40);
  const std::set<std::pair<int, int>> set = {{0, 0}, {15, 15}, {16, 16}, {69, 39}, {33, 17}};
  for (const auto& [x, y] : set) {
    image.Set(x, y, image::FragmentKey(0.5F, 1), image::Rgba8{1, 2, 3, 255});
  }
  std::set<std::pair<int, int>> found;
  for (int row = 0; row < image.touched.rows(); ++row) {
    ForEachCoveredInRow(image, row, [&](int x, int y, std::size_t pixel) {
      EXPECT_EQ(y / image::TileSet::kTilePx, row);
      EXPECT_EQ(pixel, image.IndexOf(x, y));
      EXPECT_TRUE(found.emplace(x, y).second) << x << ", " << y;
    });
  }
  EXPECT_EQ(found, set);
}

}  // namespace
}  // namespace isoscope::picture
