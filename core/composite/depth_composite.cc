#include "core/composite/depth_composite.h"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/base/check.h"

namespace isoscope::composite {
namespace {

constexpr int kImageTilePx = image::TileSet::kTilePx;

// Composites one row of a tile.
void CompositeRow(const std::uint64_t* from_keys, const image::Rgba8* from_colors, int count,
                  const image::FragmentOrder& order, std::uint64_t* keys, image::Rgba8* colors) {
  // Most rows need this pass alone: where tiles overlap, one image mostly lies wholly before the
  // other.
  std::uint32_t is_nearer = 0;
  std::uint32_t is_tied = 0;
  for (int x = 0; x < count; ++x) {
    is_nearer |= std::uint32_t{from_keys[x] < keys[x]};
    // image::AreTied without a branch: only owners differ, the low halves.
    constexpr std::uint64_t kAllOwners = 0xFFFFFFFF;
    is_tied |= std::uint32_t{(from_keys[x] ^ keys[x]) - 1 < kAllOwners};
  }
  if (is_tied != 0) [[unlikely]] {
    for (int x = 0; x < count; ++x) {
      order.KeepFirst(from_keys[x], from_colors[x], keys + x, colors + x);
    }
  } else if (is_nearer != 0) {
    for (int x = 0; x < count; ++x) {
      const bool wins = from_keys[x] < keys[x];
      keys[x] = wins ? from_keys[x] : keys[x];
      colors[x] = wins ? from_colors[x] : colors[x];
    }
  }
}

}  // namespace

void CompositeTileRowInto(const image::FrameImage& from, int tile_row,
                          const image::FragmentOrder& order, image::FrameImage* into) {
  ISOSCOPE_DCHECK(from.width == into->width && from.height == into->height);
  from.touched.ForEachInRow(tile_row, [&](int column) {
    const int begin_x = column * kImageTilePx;
    const int count = std::min(kImageTilePx, from.width - begin_x);
    const image::TileMask& covered = from.CoveredOf(column, tile_row);
    for (int y = 0; y < kImageTilePx; ++y) {
      if (covered[static_cast<std::size_t>(y)] == 0) {
        continue;
      }
      const std::size_t first = from.IndexOf(begin_x, tile_row * kImageTilePx + y);
      CompositeRow(from.keys.data() + first, from.colors.data() + first, count, order,
                   into->keys.data() + first, into->colors.data() + first);
    }
    image::UniteInto(covered, &into->CoveredOf(column, tile_row));
    into->touched.Insert(column, tile_row);
  });
}

void CompositeTileRowInto(const image::LayerStack& from, int tile_row, image::LayerStack* into) {
  for (const image::FrameImage* level : from.Levels()) {
    level->touched.ForEachInRow(tile_row, [&](int column) {
      const image::TileMask& covered = level->CoveredOf(column, tile_row);
      for (int y = 0; y < kImageTilePx; ++y) {
        for (std::uint32_t rest = covered[static_cast<std::size_t>(y)]; rest != 0;
             rest &= rest - 1) {
          const int x_px = column * kImageTilePx + std::countr_zero(rest);
          const int y_px = tile_row * kImageTilePx + y;
          const std::size_t pixel = level->IndexOf(x_px, y_px);
          if (level->keys[pixel] != image::kBackgroundKey) {
            into->Insert(x_px, y_px, level->keys[pixel], level->colors[pixel]);
          }
        }
      }
    });
  }
}

void CompositeInto(const image::FrameImage& from, const image::FragmentOrder& order,
                   image::FrameImage* into) {
  ISOSCOPE_CHECK_EQ(from.width, into->width);
  ISOSCOPE_CHECK_EQ(from.height, into->height);
  for (int row = 0; row < from.touched.rows(); ++row) {
    CompositeTileRowInto(from, row, order, into);
  }
}

void FlattenOver(image::Rgba8 background, image::FrameImage* image) {
  if (background == image::Rgba8{}) {
    return;
  }
  tbb::parallel_for(tbb::blocked_range<int>(0, image->height, kImageTilePx),
                    [&](const tbb::blocked_range<int>& rows) {
                      const std::size_t begin = image->IndexOf(0, rows.begin());
                      const std::size_t end = image->IndexOf(0, rows.end());
                      const std::uint64_t* keys = image->keys.data();
                      image::Rgba8* colors = image->colors.data();
                      for (std::size_t i = begin; i < end; ++i) {
                        colors[i] = keys[i] == image::kBackgroundKey ? background : colors[i];
                      }
                    });
  image->CoverAll();
}

}  // namespace isoscope::composite
