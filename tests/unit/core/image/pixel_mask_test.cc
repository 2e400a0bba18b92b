#include "core/image/pixel_mask.h"

#include "gtest/gtest.h"

namespace isoscope::image {
namespace {

TEST(PixelMaskTest, ACellStandsForItsPixelsAndNothingOutsideTheRectangleCounts) {
  // Cells of 4 x 4 pixels; the rectangle is cells (2, 1) to (4, 2); only cell (3, 2) is set.
  PixelMask mask{
      .shift = 2, .begin_column = 2, .begin_row = 1, .columns = 3, .rows = 2, .words = {}};
  mask.words = {std::uint64_t{1} << (1 + 1 * 3)};
  for (int y = 0; y < 20; ++y) {
    for (int x = 0; x < 30; ++x) {
      EXPECT_EQ(mask.Contains(x, y), x / 4 == 3 && y / 4 == 2) << x << " " << y;
    }
  }
}

TEST(PixelMaskTest, BitsGoOnInTheNextWord) {
  PixelMask mask{
      .shift = 0, .begin_column = 0, .begin_row = 0, .columns = 10, .rows = 10, .words = {}};
  mask.words = {0, std::uint64_t{1} << (99 - 64)};
  EXPECT_TRUE(mask.Contains(9, 9));
  EXPECT_FALSE(mask.Contains(8, 9));
}

TEST(PixelMaskTest, AnEmptyMaskContainsNothing) { EXPECT_FALSE(PixelMask().Contains(0, 0)); }

}  // namespace
}  // namespace isoscope::image
