// Predicts the depth and colour of each covered pixel of a tile from the covered pixels before it
// (docs/format/wire.md, "Pixel band"). Encoder and decoder walk tiles in the same way, so that both
// predict the same, and only differences are sent.
//
// The prediction uses the covered pixels among those to the left (L, LL), above (U, UU) and above L
// (UL):
//
//   L, U and UL   L + U - UL               continues the plane through the three
//   else L        2 L - LL, or L           continues the row; colours: L
//   else U        2 U - UU, or U           continues the column; colours: U
//   else          the covered pixel before
//
// Example: L = 10, U = 12, UL = 9 predict 13; a pixel of 15 is sent as ZigZag(15 - 13) = 4.

#ifndef ISOSCOPE_CORE_COMPOSITE_TILE_PREDICTION_H_
#define ISOSCOPE_CORE_COMPOSITE_TILE_PREDICTION_H_

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

#include "core/composite/number_code.h"
#include "core/image/tile_set.h"

namespace isoscope::composite {

inline constexpr int kTilePx = image::TileSet::kTilePx;
inline constexpr std::size_t kTilePixels = std::size_t{kTilePx} * kTilePx;

using image::TileMask;

using TileMaskWords = std::array<std::uint64_t, kTilePx / 4>;

// Returns the number of pixels in a mask. Counts by adding fields: not every x86-64 has an
// instruction for it, and std::popcount would call a function for each word.
inline std::size_t PixelCount(const TileMask& mask) {
  constexpr std::uint64_t kPairs = 0x5555555555555555;
  constexpr std::uint64_t kNibbles = 0x3333333333333333;
  constexpr std::uint64_t kBytes = 0x0f0f0f0f0f0f0f0f;
  constexpr std::uint64_t kHalves = 0x00ff00ff00ff00ff;
  std::uint64_t in_bytes = 0;
  for (std::uint64_t rows : std::bit_cast<TileMaskWords>(mask)) {
    rows -= rows >> 1 & kPairs;
    rows = (rows & kNibbles) + (rows >> 2 & kNibbles);
    in_bytes += (rows + (rows >> 4)) & kBytes;
  }
  const std::uint64_t in_halves = (in_bytes & kHalves) + (in_bytes >> 8 & kHalves);
  return static_cast<std::size_t>(in_halves * 0x0001000100010001 >> 48);
}

inline bool IsFull(const TileMask& mask) {
  std::uint64_t all = ~std::uint64_t{0};
  for (const std::uint64_t rows : std::bit_cast<TileMaskWords>(mask)) {
    all &= rows;
  }
  return all == ~std::uint64_t{0};
}

// A depth and a colour for each covered pixel of a tile, row by row, and padding that vectors may
// read.
struct TileNumbers {
  std::array<std::uint32_t, kTilePixels + kClassifyPadding> depths;
  std::array<std::uint32_t, kTilePixels + kClassifyPadding> colors;
};

// The depth and the colour of one pixel.
struct PixelNumbers {
  std::uint32_t depth = 0;
  std::uint32_t color = 0;
};

// Calls fn(prediction) for each covered pixel of a tile, in order; fn returns the pixel itself.
// `last` is the pixel before the tile's first one. Returns the last pixel of the tile.
template <typename Fn>
PixelNumbers WalkTile(const TileMask& mask, PixelNumbers last, const Fn& fn) {
  std::array<std::uint32_t, kTilePixels> depths;
  std::array<std::uint32_t, kTilePixels> colors;
  std::uint32_t above = 0;
  std::uint32_t above_2 = 0;
  for (std::size_t row = 0; row < kTilePixels; row += kTilePx) {
    const std::uint32_t here = mask[row / kTilePx];
    const std::uint32_t planar = above & above << 1;  // U and UL are covered
    // Takes neighbouring covered pixels at a time: they mostly follow the same rule.
    for (std::uint32_t rest = here; rest != 0;) {
      const int begin = std::countr_zero(rest);
      const int end = begin + std::countr_one(rest >> begin);
      std::size_t i = row + static_cast<std::size_t>(begin);
      if ((above >> begin & 1) != 0) {
        last = {depths[i - kTilePx], colors[i - kTilePx]};
        if ((above_2 >> begin & 1) != 0) {
          last.depth += depths[i - kTilePx] - depths[i - std::size_t{2} * kTilePx];
        }
      }
      last = fn(last);
      depths[i] = last.depth;
      colors[i] = last.color;
      for (int column = begin + 1; column < end;) {
        const int planar_end = std::min(end, column + std::countr_one(planar >> column));
        for (; column < planar_end; ++column) {
          ++i;
          last.depth += depths[i - kTilePx] - depths[i - kTilePx - 1];
          last.color += colors[i - kTilePx] - colors[i - kTilePx - 1];
          last = fn(last);
          depths[i] = last.depth;
          colors[i] = last.color;
        }
        const int left_end = std::min(end, column + std::countr_zero(planar >> column | 1U << 16));
        for (; column < left_end; ++column) {
          ++i;
          if (column > begin + 1) {
            last.depth += last.depth - depths[i - 2];
          }
          last = fn(last);
          depths[i] = last.depth;
          colors[i] = last.color;
        }
      }
      rest &= ~0U << end;
    }
    above_2 = above;
    above = here;
  }
  return last;
}

// Predicts the tiles of a band, which must come in order. Thread-compatible.
class TilePrediction {
 public:
  // Replaces the numbers of a tile by their differences to the prediction, as ZigZag codes. The
  // same on every instruction set.
  void Subtract(const TileMask& mask, const TileNumbers& numbers, TileNumbers* differences);

  // Replaces the differences of a tile by its numbers.
  void Add(const TileMask& mask, const TileNumbers& differences, TileNumbers* numbers) {
    if (IsFull(mask)) {
      AddInFull<true>(differences.depths.data(), last_.depth, numbers->depths.data());
      AddInFull<false>(differences.colors.data(), last_.color, numbers->colors.data());
      last_ = {numbers->depths[kTilePixels - 1], numbers->colors[kTilePixels - 1]};
      return;
    }
    std::size_t i = 0;
    last_ = WalkTile(mask, last_, [&](const PixelNumbers& expected) {
      const PixelNumbers pixel{expected.depth + UnZigZag(differences.depths[i]),
                               expected.color + UnZigZag(differences.colors[i])};
      numbers->depths[i] = pixel.depth;
      numbers->colors[i] = pixel.color;
      ++i;
      return pixel;
    });
  }

 private:
  // WalkTile for a tile whose pixels are all covered, for depths or colours. The first row and
  // column continue themselves; all other pixels follow the plane rule. There are no branches, so
  // that compilers turn it into SIMD.
  template <bool kIsDepth>
  static void SubtractInFull(const std::uint32_t* numbers, std::uint32_t last, std::uint32_t* out) {
    ForEachAtBorder<kIsDepth>(numbers, last, [&](std::size_t i, std::uint32_t expected) {
      out[i] = ZigZag(numbers[i] - expected);
    });
    for (std::size_t row = kTilePx; row < kTilePixels; row += kTilePx) {
      for (std::size_t i = row + 1; i < row + kTilePx; ++i) {
        out[i] =
            ZigZag(numbers[i] - (numbers[i - 1] + numbers[i - kTilePx] - numbers[i - kTilePx - 1]));
      }
    }
  }
  template <bool kIsDepth>
  static void AddInFull(const std::uint32_t* differences, std::uint32_t last, std::uint32_t* out) {
    ForEachAtBorder<kIsDepth>(out, last, [&](std::size_t i, std::uint32_t expected) {
      out[i] = expected + UnZigZag(differences[i]);
    });
    for (std::size_t row = kTilePx; row < kTilePixels; row += kTilePx) {
      std::array<std::uint32_t, kTilePx> steps;
      for (std::size_t x = 1; x < kTilePx; ++x) {
        const std::size_t above = row + x - kTilePx;
        steps[x] = UnZigZag(differences[row + x]) + out[above] - out[above - 1];
      }
      for (std::size_t x = 1; x < kTilePx; ++x) {
        out[row + x] = out[row + x - 1] + steps[x];
      }
    }
  }
  // Calls fn(i, prediction) for the first row, then for the first column of the other rows.
  template <bool kIsDepth, typename Fn>
  static void ForEachAtBorder(const std::uint32_t* numbers, std::uint32_t last, const Fn& fn) {
    const auto go_on = [numbers](std::size_t i, std::size_t step) {
      return kIsDepth ? 2 * numbers[i - step] - numbers[i - 2 * step] : numbers[i - step];
    };
    fn(std::size_t{0}, last);
    fn(std::size_t{1}, numbers[0]);
    for (std::size_t x = 2; x < kTilePx; ++x) {
      fn(x, go_on(x, 1));
    }
    fn(std::size_t{kTilePx}, numbers[0]);
    for (std::size_t row = std::size_t{2} * kTilePx; row < kTilePixels; row += kTilePx) {
      fn(row, go_on(row, kTilePx));
    }
  }

  PixelNumbers last_;  // the last covered pixel of the tiles so far
};

}  // namespace isoscope::composite

#endif  // ISOSCOPE_CORE_COMPOSITE_TILE_PREDICTION_H_
