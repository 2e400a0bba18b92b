// The mean of a pixel's samples, in whole numbers, so that the order of adding does not matter:
//
//   sum of lights = sum over samples of  light(colour) a 255 + light(background) b (255 - a)
//   sum of alphas = sum over samples of  a 255 + b (255 - a)
//
// a is the sample's alpha and b the background's, both 0 .. 255. The pixel's colour is the quotient
// of the two sums, its alpha the second one over 255 times the number of samples; both are rounded
// to the nearest. If all samples are opaque, this is the mean of their lights: the usual case,
// which needs 32 bits and one division by a constant.
//
// Example, 4 samples over opaque black: two are 255 and two are background. The mean light is half
// of 65535, whose nearest sRGB value is 188 (not 128).

#include "core/picture/downsample.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/base/check.h"
#include "core/image/tile_set.h"
#include "core/picture/linear_light.h"

namespace isoscope::picture {
namespace {

using image::Rgba8;
using image::TileSet;

// The samples of a pixel: rows of kSide colours.
template <std::size_t kSide>
using Samples = std::array<const Rgba8*, kSide>;

template <std::size_t kSide, typename Fn>
void ForEachSample(const Samples<kSide>& samples, const Fn& fn) {
  for (const Rgba8* row : samples) {
    for (std::size_t x = 0; x < kSide; ++x) {
      fn(row[x]);
    }
  }
}

template <std::size_t kSide>
Rgba8 MeanOfOpaque(const LinearLightTables& tables, const Samples<kSide>& samples) {
  constexpr std::uint32_t kCount = kSide * kSide;
  std::uint32_t r = kCount / 2;  // rounds
  std::uint32_t g = kCount / 2;
  std::uint32_t b = kCount / 2;
  ForEachSample<kSide>(samples, [&](Rgba8 color) {
    r += tables.light[color.r];
    g += tables.light[color.g];
    b += tables.light[color.b];
  });
  return {tables.srgb[r / kCount], tables.srgb[g / kCount], tables.srgb[b / kCount], 255};
}

template <std::size_t kSide>
Rgba8 MeanOfAny(const LinearLightTables& tables, const Samples<kSide>& samples, Rgba8 background) {
  std::uint64_t r = 0;
  std::uint64_t g = 0;
  std::uint64_t b = 0;
  std::uint64_t alpha = 0;
  ForEachSample<kSide>(samples, [&](Rgba8 color) {
    const Rgba8 shown = color.a == 0 ? background : color;
    const std::uint64_t weight = shown.a;
    r += tables.light[shown.r] * weight;
    g += tables.light[shown.g] * weight;
    b += tables.light[shown.b] * weight;
    alpha += weight;
  });
  if (alpha == 0) {
    return {};
  }
  constexpr std::uint64_t kCount = kSide * kSide;
  const auto mean = [&](std::uint64_t sum) { return tables.srgb[(sum + alpha / 2) / alpha]; };
  return {mean(r), mean(g), mean(b), static_cast<std::uint8_t>((alpha + kCount / 2) / kCount)};
}

// Returns the pixel of these samples; alpha 0 if all of them are background.
template <std::size_t kSide>
Rgba8 MeanOf(const LinearLightTables& tables, const Samples<kSide>& samples, Rgba8 background) {
  std::uint8_t all = 255;
  std::uint8_t any = 0;
  ForEachSample<kSide>(samples, [&](Rgba8 color) {
    all &= color.a;
    any |= color.a;
  });
  if (all == 255) {
    return MeanOfOpaque<kSide>(tables, samples);
  }
  return any == 0 ? Rgba8{} : MeanOfAny<kSide>(tables, samples, background);
}

// Whether a tile of `drawn` that has a pixel of [begin_x, end_x) x [begin_y, end_y) was drawn on.
bool IsTouched(const image::FrameImage& drawn, int begin_x, int begin_y, int end_x, int end_y) {
  for (int row = begin_y / TileSet::kTilePx; row * TileSet::kTilePx < end_y; ++row) {
    for (int column = begin_x / TileSet::kTilePx; column * TileSet::kTilePx < end_x; ++column) {
      if (drawn.touched.Contains(column, row)) {
        return true;
      }
    }
  }
  return false;
}

// Makes the pixels of one tile of the picture.
template <std::size_t kSide>
void DownsampleTile(const image::FrameImage& drawn, const SampleGrid& grid, Rgba8 background,
                    int column, int row, image::FrameImage* picture) {
  constexpr int kScale = static_cast<int>(kSide);
  const LinearLightTables& tables = LinearLight();
  const int begin_x = column * TileSet::kTilePx;
  const int begin_y = row * TileSet::kTilePx;
  const int end_x = std::min(begin_x + TileSet::kTilePx, picture->width);
  const int end_y = std::min(begin_y + TileSet::kTilePx, picture->height);
  if (!IsTouched(drawn, grid.begin_x + begin_x * kScale, grid.begin_y + begin_y * kScale,
                 grid.begin_x + end_x * kScale, grid.begin_y + end_y * kScale)) {
    return;
  }
  picture->touched.Insert(column, row);
  image::TileMask& covered = picture->CoveredOf(column, row);
  for (int y = begin_y; y < end_y; ++y) {
    Samples<kSide> samples;
    for (std::size_t k = 0; k < kSide; ++k) {
      samples[k] = &drawn.colors[drawn.IndexOf(grid.begin_x + begin_x * kScale,
                                               grid.begin_y + y * kScale + static_cast<int>(k))];
    }
    Rgba8* const to = &picture->colors[picture->IndexOf(begin_x, y)];
    std::uint16_t mask = 0;
    for (int x = 0; x < end_x - begin_x; ++x) {
      to[x] = MeanOf<kSide>(tables, samples, background);
      mask = static_cast<std::uint16_t>(mask | (to[x].a != 0 ? 1 << x : 0));
      for (const Rgba8*& sample_row : samples) {
        sample_row += kSide;
      }
    }
    covered[static_cast<std::size_t>(y - begin_y)] = mask;
  }
}

template <std::size_t kSide>
void DownsampleAll(const image::FrameImage& drawn, const SampleGrid& grid, Rgba8 background,
                   image::FrameImage* picture) {
  // Rows of tiles, because each has words of its own in `touched`.
  tbb::parallel_for(tbb::blocked_range<int>(0, picture->touched.rows(), 1),
                    [&](const tbb::blocked_range<int>& rows) {
                      for (int row = rows.begin(); row < rows.end(); ++row) {
                        for (int column = 0; column < picture->touched.columns(); ++column) {
                          DownsampleTile<kSide>(drawn, grid, background, column, row, picture);
                        }
                      }
                    });
}

}  // namespace

void Downsample(const image::FrameImage& drawn, const SampleGrid& grid, Rgba8 background,
                image::FrameImage* picture) {
  ISOSCOPE_CHECK_LE(grid.begin_x + picture->width * grid.samples_per_side, drawn.width);
  ISOSCOPE_CHECK_LE(grid.begin_y + picture->height * grid.samples_per_side, drawn.height);
  switch (grid.samples_per_side) {
    case 1:
      return DownsampleAll<1>(drawn, grid, background, picture);
    case 2:
      return DownsampleAll<2>(drawn, grid, background, picture);
    case 3:
      return DownsampleAll<3>(drawn, grid, background, picture);
    default:
      ISOSCOPE_CHECK_EQ(grid.samples_per_side, 4);
      return DownsampleAll<4>(drawn, grid, background, picture);
  }
}

void Crop(const image::FrameImage& drawn, int begin_x, int begin_y, image::FrameImage* picture) {
  ISOSCOPE_CHECK_LE(begin_x + picture->width, drawn.width);
  ISOSCOPE_CHECK_LE(begin_y + picture->height, drawn.height);
  constexpr int kRowsPerTask = 16;
  tbb::parallel_for(
      tbb::blocked_range<int>(0, picture->height, kRowsPerTask),
      [&](const tbb::blocked_range<int>& rows) {
        for (int y = rows.begin(); y < rows.end(); ++y) {
          const std::size_t from = drawn.IndexOf(begin_x, begin_y + y);
          const std::size_t to = picture->IndexOf(0, y);
          std::copy_n(drawn.keys.data() + from, picture->width, picture->keys.data() + to);
          std::copy_n(drawn.colors.data() + from, picture->width, picture->colors.data() + to);
        }
      });
  picture->CoverAll();
}

}  // namespace isoscope::picture
