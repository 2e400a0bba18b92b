#include "core/image/tile_set.h"

#include <vector>

#include "gtest/gtest.h"

namespace isoscope::image {
namespace {

std::vector<int> TilesInRow(const TileSet& tiles, int row) {
  std::vector<int> columns;
  tiles.ForEachInRow(row, [&](int column) { columns.push_back(column); });
  return columns;
}

TEST(TileSetTest, PartTilesAtTheBorderCount) {
  const TileSet tiles(33, 16);
  EXPECT_EQ(tiles.columns(), 3);
  EXPECT_EQ(tiles.rows(), 1);
}

TEST(TileSetTest, InsertPixelsTakesEveryTileThatTheRectangleTouches) {
  for (int begin = 0; begin < 40; ++begin) {
    for (int end = begin + 1; end <= 40; ++end) {
      TileSet tiles(40, 20);
      tiles.InsertPixels(begin, 3, end, 5);
      for (int column = 0; column < tiles.columns(); ++column) {
        const bool touches = begin < (column + 1) * 16 && end > column * 16;
        EXPECT_EQ(tiles.Contains(column, 0), touches) << begin << " " << end << " " << column;
        EXPECT_FALSE(tiles.Contains(column, 1));
      }
    }
  }
}

TEST(TileSetTest, RowsAreVisitedInOrderAcrossWords) {
  TileSet tiles(16 * 200, 32);
  for (const int column : {0, 63, 64, 127, 128, 199}) {
    tiles.Insert(column, 1);
  }
  EXPECT_EQ(TilesInRow(tiles, 1), (std::vector<int>{0, 63, 64, 127, 128, 199}));
  EXPECT_TRUE(TilesInRow(tiles, 0).empty());
  EXPECT_EQ(tiles.Count(), 6U);
}

TEST(TileSetTest, ClearAndInsertAll) {
  TileSet a(64, 64);
  a.Insert(3, 3);
  a.Clear();
  EXPECT_EQ(a, TileSet(64, 64));
  a.InsertAll();
  for (int row = 0; row < 4; ++row) {
    EXPECT_EQ(TilesInRow(a, row), (std::vector<int>{0, 1, 2, 3}));
  }
}

}  // namespace
}  // namespace isoscope::image
