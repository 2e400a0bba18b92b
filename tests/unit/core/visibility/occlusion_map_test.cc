// The pyramid must give the answers of a test of each pixel (CanWin):
//
// - Hides, for random rectangles and depths, for both kinds of maps;
// - open cells: exactly those with a pixel that can be won;
// - equal depths, the far plane, empty tiles, the default map, empty footprints.

#include "core/visibility/occlusion_map.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <tuple>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/random.h"

namespace isoscope::visibility {
namespace {

// Surfaces with holes, at depths that differ little, so that both answers of a test are frequent.
// The seed decides which whole tiles are missing.
image::FrameImage MakeImage(int width, int height, std::uint64_t seed, double hole_share) {
  image::FrameImage image(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const std::uint64_t i = image.IndexOf(x, y);
      const auto tile = static_cast<std::uint64_t>(x / 16 + 1000 * (y / 16));
      if (base::RandomUnit(seed, 2 * i) < hole_share ||
          base::RandomUnit(seed + 1000, tile) < hole_share) {
        continue;
      }
      const auto depth = static_cast<float>(0.3 + 0.2 * std::sin(0.1 * x) * std::cos(0.07 * y) +
                                            0.01 * base::RandomUnit(seed, 2 * i + 1));
      image.Set(x, y, image::FragmentKey(depth, static_cast<std::uint32_t>(i % 5)), {});
    }
  }
  return image;
}

view::Footprint RandomFootprint(int width, int height, std::uint64_t seed, std::uint64_t n) {
  view::Footprint footprint;
  const double largest = n % 4 == 0 ? 1.0 : 0.15;
  const auto side = [&](std::uint64_t k, int size) {
    const int length =
        1 + static_cast<int>(base::RandomUnit(seed, 8 * n + k) * largest * (size - 1));
    const int begin = static_cast<int>(base::RandomUnit(seed, 8 * n + k + 1) * (size - length + 1));
    return std::pair<int, int>{begin, begin + length};
  };
  std::tie(footprint.rect.begin_x, footprint.rect.end_x) = side(0, width);
  std::tie(footprint.rect.begin_y, footprint.rect.end_y) = side(2, height);
  footprint.nearest_depth = static_cast<float>(0.05 + 0.6 * base::RandomUnit(seed, 8 * n + 4));
  return footprint;
}

// Whether a fragment of that depth can still win the pixel, by the definition of the map's kind.
bool CanWin(const image::FrameImage& image, MapKind kind, int x, int y, float nearest_depth) {
  const std::uint64_t key = image.keys[image.IndexOf(x, y)];
  return key == image::kBackgroundKey ||
         (kind == MapKind::kDepth && nearest_depth <= image::DepthOf(key));
}

bool HidesByBruteForce(const image::FrameImage& image, MapKind kind,
                       const view::Footprint& footprint) {
  const view::PixelRect& rect = footprint.rect;
  for (int y = rect.begin_y; y < rect.end_y; ++y) {
    for (int x = rect.begin_x; x < rect.end_x; ++x) {
      if (CanWin(image, kind, x, y, footprint.nearest_depth)) {
        return false;
      }
    }
  }
  return true;
}

const std::vector<std::pair<int, int>> kSizes{{1, 1},     {1, 50},  {16, 16},  {64, 64},
                                              {131, 177}, {200, 3}, {300, 290}};

TEST(OcclusionMapTest, HidesExactlyWhatEveryPixelHides) {
  int hidden = 0;
  int shown = 0;
  for (const auto& [width, height] : kSizes) {
    for (const double hole_share : {0.0, 0.0005, 0.5}) {
      const image::FrameImage image =
          MakeImage(width, height, static_cast<std::uint64_t>(width), hole_share);
      for (const MapKind kind : {MapKind::kDepth, MapKind::kMask}) {
        const OcclusionMap map = OcclusionMap::FromImage(image, kind);
        for (std::uint64_t n = 0; n < 400; ++n) {
          const view::Footprint footprint = RandomFootprint(width, height, 77, n);
          const bool expected = HidesByBruteForce(image, kind, footprint);
          ASSERT_EQ(map.Hides(footprint), expected) << width << " x " << height << " case " << n;
          ++(expected ? hidden : shown);
        }
      }
    }
  }
  EXPECT_GT(hidden, 2000);
  EXPECT_GT(shown, 2000);
}

TEST(OcclusionMapTest, OpenCellsAreThoseWithAPixelThatCanBeWon) {
  std::int64_t open = 0;
  std::int64_t closed = 0;
  std::int64_t coarse = 0;
  for (const auto& [width, height] : kSizes) {
    for (const double hole_share : {0.0, 0.0005, 0.5}) {
      const image::FrameImage image =
          MakeImage(width, height, static_cast<std::uint64_t>(width), hole_share);
      for (const MapKind kind : {MapKind::kDepth, MapKind::kMask}) {
        const OcclusionMap map = OcclusionMap::FromImage(image, kind);
        for (std::uint64_t n = 0; n < 60; ++n) {
          const view::Footprint footprint = RandomFootprint(width, height, 78, n);
          const image::PixelMask mask = map.OpenPixels(footprint);
          coarse += mask.shift > 0 ? 1 : 0;
          image::PixelMask expected = ClosedMaskOf(footprint.rect);
          for (int row = 0; row < expected.rows; ++row) {
            for (int column = 0; column < expected.columns; ++column) {
              const int cell_x = (expected.begin_column + column) << expected.shift;
              const int cell_y = (expected.begin_row + row) << expected.shift;
              const bool is_open = !HidesByBruteForce(
                  image, kind,
                  {{cell_x, cell_y, std::min(cell_x + (1 << expected.shift), width),
                    std::min(cell_y + (1 << expected.shift), height)},
                   footprint.nearest_depth});
              const auto bit = static_cast<std::size_t>(row * expected.columns + column);
              expected.words[bit / 64] |= std::uint64_t{is_open} << (bit % 64);
              ++(is_open ? open : closed);
            }
          }
          ASSERT_EQ(mask, expected) << width << " x " << height << " case " << n;
        }
      }
    }
  }
  EXPECT_GT(open, 50000);
  EXPECT_GT(closed, 50000);
  EXPECT_GT(coarse, 100);
}

TEST(OcclusionMapTest, NoFragmentThatCouldWinIsOutsideTheOpenPixels) {
  for (const double hole_share : {0.0, 0.01}) {
    const image::FrameImage image = MakeImage(190, 170, 5, hole_share);
    for (const MapKind kind : {MapKind::kDepth, MapKind::kMask}) {
      const OcclusionMap map = OcclusionMap::FromImage(image, kind);
      for (std::uint64_t n = 0; n < 500; ++n) {
        const view::Footprint footprint = RandomFootprint(190, 170, 6, n);
        const image::PixelMask mask = map.OpenPixels(footprint);
        const bool hides = map.Hides(footprint);
        for (int y = footprint.rect.begin_y; y < footprint.rect.end_y; ++y) {
          for (int x = footprint.rect.begin_x; x < footprint.rect.end_x; ++x) {
            if (CanWin(image, kind, x, y, footprint.nearest_depth)) {
              ASSERT_TRUE(mask.Contains(x, y)) << x << ", " << y << " case " << n;
              ASSERT_FALSE(hides);
            } else if (mask.shift == 0) {
              ASSERT_FALSE(mask.Contains(x, y)) << x << ", " << y << " case " << n;
            }
          }
        }
      }
    }
  }
}

TEST(OcclusionMapTest, EqualDepthIsNotHidden) {
  image::FrameImage image(1, 1);
  image.Set(0, 0, image::FragmentKey(0.5F, 0), {});
  const OcclusionMap map = OcclusionMap::FromImage(image, MapKind::kDepth);
  EXPECT_FALSE(map.Hides({{0, 0, 1, 1}, 0.5F}));
  EXPECT_TRUE(map.Hides({{0, 0, 1, 1}, std::nextafter(0.5F, 1.0F)}));
  EXPECT_TRUE(map.OpenPixels({{0, 0, 1, 1}, 0.5F}).Contains(0, 0));
  EXPECT_FALSE(map.OpenPixels({{0, 0, 1, 1}, std::nextafter(0.5F, 1.0F)}).Contains(0, 0));
}

TEST(OcclusionMapTest, ASurfaceAtTheFarPlaneCovers) {
  image::FrameImage image(2, 1);
  image.Set(0, 0, image::FragmentKey(1.0F, 3), {});
  const OcclusionMap mask = OcclusionMap::FromImage(image, MapKind::kMask);
  EXPECT_TRUE(mask.Hides({{0, 0, 1, 1}, 0.0F}));
  EXPECT_FALSE(mask.Hides({{0, 0, 2, 1}, 0.0F}));
  EXPECT_FALSE(OcclusionMap::FromImage(image, MapKind::kDepth).Hides({{0, 0, 1, 1}, 1.0F}));
}

TEST(OcclusionMapTest, TilesTouchedInVainAreUncovered) {
  image::FrameImage image(100, 100);
  image.touched.InsertAll();
  const OcclusionMap map = OcclusionMap::FromImage(image, MapKind::kDepth);
  EXPECT_FALSE(map.Hides({{10, 10, 12, 12}, 1.0F}));
  EXPECT_TRUE(map.OpenPixels({{10, 10, 12, 12}, 1.0F}).Contains(11, 11));
}

TEST(OcclusionMapTest, TheDefaultMapHidesNothing) {
  const OcclusionMap nothing;
  EXPECT_FALSE(nothing.Hides({{}, 1.0F}));
  EXPECT_FALSE(nothing.Hides({{0, 0, 3, 3}, 1.0F}));
  const image::PixelMask mask = nothing.OpenPixels({{100, 200, 171, 203}, 1.0F});
  for (int y = 200; y < 203; ++y) {
    for (int x = 100; x < 171; ++x) {
      ASSERT_TRUE(mask.Contains(x, y));
    }
  }
}

TEST(OcclusionMapTest, AnEmptyFootprintIsHiddenAndHasNoCell) {
  const image::FrameImage image = MakeImage(20, 20, 1, 0.0);
  const OcclusionMap map = OcclusionMap::FromImage(image, MapKind::kMask);
  EXPECT_TRUE(map.Hides({{}, 0.0F}));
  EXPECT_EQ(map.OpenPixels({{}, 0.0F}), image::PixelMask());
}

TEST(ClosedMaskTest, CellsAreAsFineAsTheLimitAllowsAndCoverTheRectangle) {
  for (std::uint64_t n = 0; n < 2000; ++n) {
    const view::PixelRect rect = RandomFootprint(1000, 700, 3, n).rect;
    const image::PixelMask mask = ClosedMaskOf(rect);
    const int longer = std::max(mask.columns, mask.rows);
    ASSERT_LE(longer, kMaxMaskSide);
    ASSERT_EQ(mask.begin_column, rect.begin_x >> mask.shift);
    ASSERT_EQ(mask.begin_row, rect.begin_y >> mask.shift);
    ASSERT_EQ(mask.begin_column + mask.columns, ((rect.end_x - 1) >> mask.shift) + 1);
    ASSERT_EQ(mask.begin_row + mask.rows, ((rect.end_y - 1) >> mask.shift) + 1);
    if (mask.shift > 0) {
      const int finer = mask.shift - 1;
      ASSERT_GT(std::max(((rect.end_x - 1) >> finer) - (rect.begin_x >> finer),
                         ((rect.end_y - 1) >> finer) - (rect.begin_y >> finer)) +
                    1,
                kMaxMaskSide);
    }
    ASSERT_EQ(mask.words.size(), static_cast<std::size_t>((mask.columns * mask.rows + 63) / 64));
    ASSERT_EQ(std::count(mask.words.begin(), mask.words.end(), 0U),
              static_cast<std::ptrdiff_t>(mask.words.size()));
  }
}

}  // namespace
}  // namespace isoscope::visibility
