#include "core/composite/depth_composite.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/base/check.h"

namespace isoscope::composite {
namespace {

constexpr int kTilePx = image::TileSet::kTilePx;

}  // namespace

void CompositeInto(const image::FrameImage& from, image::FrameImage* into) {
  ISOSCOPE_CHECK_EQ(from.width, into->width);
  ISOSCOPE_CHECK_EQ(from.height, into->height);
  for (int row = 0; row < from.touched.rows(); ++row) {
    from.touched.ForEachInRow(row, [&](int column) {
      const int begin_x = column * kTilePx;
      const int count = std::min(kTilePx, from.width - begin_x);
      const image::TileMask& covered = from.CoveredOf(column, row);
      for (int y = 0; y < kTilePx; ++y) {
        if (covered[static_cast<std::size_t>(y)] == 0) {
          continue;
        }
        const std::size_t first = from.IndexOf(begin_x, row * kTilePx + y);
        const std::uint64_t* from_keys = from.keys.data() + first;
        const image::Rgba8* from_colors = from.colors.data() + first;
        std::uint64_t* keys = into->keys.data() + first;
        image::Rgba8* colors = into->colors.data() + first;
        // Looked at first: where tiles overlap, mostly one image is before the other.
        std::uint32_t any = 0;
        for (int x = 0; x < count; ++x) {
          any |= std::uint32_t{from_keys[x] < keys[x]};
        }
        if (any == 0) {
          continue;
        }
        for (int x = 0; x < count; ++x) {
          const bool wins = from_keys[x] < keys[x];
          keys[x] = wins ? from_keys[x] : keys[x];
          colors[x] = wins ? from_colors[x] : colors[x];
        }
      }
      image::UniteInto(covered, &into->CoveredOf(column, row));
    });
  }
  into->touched.InsertAllOf(from.touched);
}

void FlattenOver(image::Rgba8 background, image::FrameImage* image) {
  if (background == image::Rgba8{}) {
    return;
  }
  tbb::parallel_for(tbb::blocked_range<int>(0, image->height, kTilePx),
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
