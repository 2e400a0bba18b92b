// A tile is merged row by row. With AVX-512 a row of 16 pixels is two registers of keys and one of
// colours; elsewhere one pass finds the rows that change at all. Both give the same bits.

#include "core/composite/depth_composite.h"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/base/check.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/composite/depth_composite.cc"
#include "hwy/foreach_target.h"  // IWYU pragma: keep
//
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::composite {
namespace HWY_NAMESPACE {
namespace {

// Keeps the nearer one of two fragments at each covered pixel of a tile, whose first `count`
// columns lie in the image. Leaves pixels of equal depth, and returns whether there is one. Two
// fragments may even have one owner: a block's caps and triangles may come with different steps.
bool KeepNearer(const image::TileMask& covered, [[maybe_unused]] int count, std::size_t stride,
                const std::uint64_t* from_keys, const image::Rgba8* from_colors,
                std::uint64_t* keys, image::Rgba8* colors) {
  std::uint32_t ties = 0;
  for (const std::uint32_t row_mask : covered) {
    if (row_mask != 0) {
#if HWY_TARGET <= HWY_AVX3 && HWY_ARCH_X86
      const auto keep_half = [&](std::uint32_t half, const std::uint64_t* from,
                                 std::uint64_t* into) {
        const auto lanes = static_cast<__mmask8>(half);
        const __m512i from_key = _mm512_maskz_loadu_epi64(lanes, from);
        const __m512i key = _mm512_maskz_loadu_epi64(lanes, into);
        const __m512i from_depth = _mm512_maskz_srli_epi64(lanes, from_key, 32);
        const __m512i depth = _mm512_maskz_srli_epi64(lanes, key, 32);
        ties |= _mm512_mask_cmpeq_epu64_mask(lanes, from_depth, depth);
        const __mmask8 nearer = _mm512_mask_cmplt_epu64_mask(lanes, from_depth, depth);
        _mm512_mask_storeu_epi64(into, nearer, from_key);
        return static_cast<std::uint32_t>(nearer);
      };
      std::uint32_t nearer = keep_half(row_mask & 0xff, from_keys, keys);
      nearer |= keep_half(row_mask >> 8, from_keys + 8, keys + 8) << 8;
      const auto lanes = static_cast<__mmask16>(nearer);
      _mm512_mask_storeu_epi32(colors, lanes, _mm512_maskz_loadu_epi32(lanes, from_colors));
#else
      // Most rows need this pass alone: where tiles overlap, one image mostly lies wholly before
      // the other. A pixel outside of the mask has the background's key in `from`.
      std::uint32_t is_nearer = 0;
      for (int x = 0; x < count; ++x) {
        is_nearer |= std::uint32_t{from_keys[x] < keys[x]};
        // image::HaveEqualDepth without a branch.
        constexpr std::uint64_t kAllOwners = 0xFFFFFFFF;
        ties |= std::uint32_t{(from_keys[x] ^ keys[x]) <= kAllOwners} &
                std::uint32_t{from_keys[x] != image::kBackgroundKey};
      }
      if (is_nearer != 0) {
        for (int x = 0; x < count; ++x) {
          const bool wins = from_keys[x] >> 32 < keys[x] >> 32;
          keys[x] = wins ? from_keys[x] : keys[x];
          colors[x] = wins ? from_colors[x] : colors[x];
        }
      }
#endif
    }
    from_keys += stride;
    from_colors += stride;
    keys += stride;
    colors += stride;
  }
  return ties != 0;
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace isoscope::composite
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace isoscope::composite {
namespace {

constexpr int kImageTilePx = image::TileSet::kTilePx;

HWY_EXPORT(KeepNearer);

}  // namespace

void CompositeTileRowInto(const image::FrameImage& from, int tile_row,
                          const image::FragmentOrder& order, image::FrameImage* into) {
  ISOSCOPE_DCHECK(from.width == into->width && from.height == into->height);
  from.touched.ForEachInRow(tile_row, [&](int column) {
    const int begin_x = column * kImageTilePx;
    const int count = std::min(kImageTilePx, from.width - begin_x);
    const image::TileMask& covered = from.CoveredOf(column, tile_row);
    const std::size_t first = from.IndexOf(begin_x, tile_row * kImageTilePx);
    const auto stride = static_cast<std::size_t>(from.width);
    const std::uint64_t* from_keys = from.keys.data() + first;
    const image::Rgba8* from_colors = from.colors.data() + first;
    std::uint64_t* keys = into->keys.data() + first;
    image::Rgba8* colors = into->colors.data() + first;
    const bool has_ties = HWY_DYNAMIC_DISPATCH(KeepNearer)(covered, count, stride, from_keys,
                                                           from_colors, keys, colors);
    if (has_ties) [[unlikely]] {
      for (std::size_t y = 0; y < covered.size(); ++y) {
        for (std::uint32_t rest = covered[y]; rest != 0; rest &= rest - 1) {
          const std::size_t pixel = y * stride + static_cast<std::size_t>(std::countr_zero(rest));
          order.KeepFirst(from_keys[pixel], from_colors[pixel], keys + pixel, colors + pixel);
        }
      }
    }
    image::UniteInto(covered, &into->CoveredOf(column, tile_row));
    into->touched.Insert(column, tile_row);
  });
}

void CompositeTileRowInto(const image::LayerStack& from, int tile_row, image::LayerStack* into) {
  for (const image::FrameImage* layer_image : from.LayerImages()) {
    layer_image->touched.ForEachInRow(tile_row, [&](int column) {
      const image::TileMask& covered = layer_image->CoveredOf(column, tile_row);
      for (int y = 0; y < kImageTilePx; ++y) {
        for (std::uint32_t rest = covered[static_cast<std::size_t>(y)]; rest != 0;
             rest &= rest - 1) {
          const int x_px = column * kImageTilePx + std::countr_zero(rest);
          const int y_px = tile_row * kImageTilePx + y;
          const std::size_t pixel = layer_image->IndexOf(x_px, y_px);
          if (layer_image->keys[pixel] != image::kBackgroundKey) {
            into->Insert(x_px, y_px, layer_image->keys[pixel], layer_image->colors[pixel]);
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

#endif  // HWY_ONCE
