// What the pixels before let one expect of a pixel's depth and colour, tile by tile
// (docs/format/wire.md). Encoder and decoder walk tiles in the same way.

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

inline int PixelCount(const TileMask& mask) {
  int count = 0;
  for (const std::uint64_t rows : std::bit_cast<std::array<std::uint64_t, kTilePx / 4>>(mask)) {
    count += std::popcount(rows);
  }
  return count;
}

// Two numbers for each covered pixel of a tile, row by row, and room for vectors to read past them.
struct TileNumbers {
  std::array<std::uint32_t, kTilePixels + kClassifyPadding> depths;
  std::array<std::uint32_t, kTilePixels + kClassifyPadding> colors;
};

// Tiles must be taken in order. Thread-compatible.
class TilePrediction {
 public:
  // The differences of a tile's numbers to what was expected of them, as ZigZag codes.
  void Subtract(const TileMask& mask, const TileNumbers& numbers, TileNumbers* differences) {
    if (PixelCount(mask) == static_cast<int>(kTilePixels)) {
      SubtractInFull<true>(numbers.depths.data(), last_.depth, differences->depths.data());
      SubtractInFull<false>(numbers.colors.data(), last_.color, differences->colors.data());
      last_ = {numbers.depths[kTilePixels - 1], numbers.colors[kTilePixels - 1]};
      return;
    }
    std::size_t i = 0;
    Walk(mask, [&](const Number& expected) {
      const Number number{numbers.depths[i], numbers.colors[i]};
      differences->depths[i] = ZigZag(number.depth - expected.depth);
      differences->colors[i] = ZigZag(number.color - expected.color);
      ++i;
      return number;
    });
  }

  // The other way.
  void Add(const TileMask& mask, const TileNumbers& differences, TileNumbers* numbers) {
    if (PixelCount(mask) == static_cast<int>(kTilePixels)) {
      AddInFull<true>(differences.depths.data(), last_.depth, numbers->depths.data());
      AddInFull<false>(differences.colors.data(), last_.color, numbers->colors.data());
      last_ = {numbers->depths[kTilePixels - 1], numbers->colors[kTilePixels - 1]};
      return;
    }
    std::size_t i = 0;
    Walk(mask, [&](const Number& expected) {
      const Number number{expected.depth + UnZigZag(differences.depths[i]),
                          expected.color + UnZigZag(differences.colors[i])};
      numbers->depths[i] = number.depth;
      numbers->colors[i] = number.color;
      ++i;
      return number;
    });
  }

 private:
  struct Number {
    std::uint32_t depth = 0;
    std::uint32_t color = 0;
  };
  static constexpr std::ptrdiff_t kStride = kTilePx;

  // Calls fn(what to expect) for each covered pixel, in order; fn returns what it is.
  template <typename Fn>
  void Walk(const TileMask& mask, const Fn& fn) {
    std::uint32_t above = 0;
    std::uint32_t above_2 = 0;
    Number last = last_;
    for (std::size_t row = 0; row < kTilePx; ++row) {
      const std::uint32_t here = mask[row];
      const std::uint32_t left = here << 1;
      const std::uint32_t planar = here & left & above & (above << 1);
      for (std::uint32_t rest = here; rest != 0; rest &= rest - 1) {
        const std::size_t index =
            std::size_t{kTilePx} * row + static_cast<std::size_t>(std::countr_zero(rest));
        const std::uint32_t bit = rest & (0U - rest);
        std::uint32_t* const depth = &depths_[index];
        std::uint32_t* const color = &colors_[index];
        if ((planar & bit) != 0) {
          last.depth = depth[-1] + depth[-kStride] - depth[-kStride - 1];
          last.color = color[-1] + color[-kStride] - color[-kStride - 1];
        } else if ((left & bit) != 0) {
          last = {depth[-1], color[-1]};
          if ((left << 1 & bit) != 0) {
            last.depth += depth[-1] - depth[-2];
          }
        } else if ((above & bit) != 0) {
          last = {depth[-kStride], color[-kStride]};
          if ((above_2 & bit) != 0) {
            last.depth += depth[-kStride] - depth[-2 * kStride];
          }
        }
        last = fn(last);
        *depth = last.depth;
        *color = last.color;
      }
      above_2 = above;
      above = here;
    }
    last_ = last;
  }

  // Walk of a tile with every pixel covered, one number of the two. Depths go on as they went,
  // colours stay; inside both are planar. Without branches: compilers make vectors of it.
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
  // Calls fn(i, what to expect) for the first row, then for the first column of the others.
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

  std::array<std::uint32_t, kTilePixels> depths_;
  std::array<std::uint32_t, kTilePixels> colors_;
  Number last_;  // the pixel before; across tiles too
};

}  // namespace isoscope::composite

#endif  // ISOSCOPE_CORE_COMPOSITE_TILE_PREDICTION_H_
