#include "core/composite/tile_prediction.h"

#include <cstddef>
#include <cstdint>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/random.h"

namespace isoscope::composite {
namespace {

TileMask MaskOf(double share, std::uint64_t seed) {
  TileMask mask{};
  for (std::size_t row = 0; row < kTilePx; ++row) {
    for (std::size_t column = 0; column < kTilePx; ++column) {
      if (base::RandomUnit(seed, kTilePx * row + column) < share) {
        mask[row] = static_cast<std::uint16_t>(mask[row] | 1U << column);
      }
    }
  }
  return mask;
}

TileNumbers NumbersOf(std::uint64_t seed) {
  TileNumbers numbers{};
  for (std::size_t i = 0; i < kTilePixels; ++i) {
    numbers.depths[i] = static_cast<std::uint32_t>(0x1p32 * base::RandomUnit(seed, 2 * i));
    numbers.colors[i] = static_cast<std::uint32_t>(0x1p32 * base::RandomUnit(seed, 2 * i + 1));
  }
  return numbers;
}

TEST(TilePredictionTest, WhatWasSubtractedIsAddedBackTileByTile) {
  TilePrediction encoder;
  TilePrediction decoder;
  std::uint64_t seed = 1;
  for (const double share : {1.0, 0.5, 1.0, 1.0, 0.05, 0.0, 0.95, 1.0}) {
    const TileMask mask = MaskOf(share, ++seed);
    const TileNumbers numbers = NumbersOf(++seed);
    TileNumbers differences{};
    encoder.Subtract(mask, numbers, &differences);
    TileNumbers decoded{};
    decoder.Add(mask, differences, &decoded);
    for (int i = 0; i < PixelCount(mask); ++i) {
      const auto at = static_cast<std::size_t>(i);
      ASSERT_EQ(decoded.depths[at], numbers.depths[at]) << share << ", " << i;
      ASSERT_EQ(decoded.colors[at], numbers.colors[at]) << share << ", " << i;
    }
  }
}

// docs/format/wire.md's table, read off for one tile with every pixel covered.
TEST(TilePredictionTest, AFullTileIsExpectedAsTheFormatSays) {
  const TileNumbers numbers = NumbersOf(5);
  const TileNumbers before = NumbersOf(6);
  TileMask full;
  full.fill(0xffff);
  TilePrediction prediction;
  TileNumbers differences{};
  prediction.Subtract(full, before, &differences);
  prediction.Subtract(full, numbers, &differences);
  const auto& d = numbers.depths;
  const auto& c = numbers.colors;
  for (std::size_t y = 0; y < kTilePx; ++y) {
    for (std::size_t x = 0; x < kTilePx; ++x) {
      const std::size_t i = kTilePx * y + x;
      std::uint32_t depth = before.depths[kTilePixels - 1];
      std::uint32_t color = before.colors[kTilePixels - 1];
      if (x > 0 && y > 0) {
        depth = d[i - 1] + d[i - 16] - d[i - 17];
        color = c[i - 1] + c[i - 16] - c[i - 17];
      } else if (x > 0) {
        depth = x > 1 ? 2 * d[i - 1] - d[i - 2] : d[i - 1];
        color = c[i - 1];
      } else if (y > 0) {
        depth = y > 1 ? 2 * d[i - 16] - d[i - 32] : d[i - 16];
        color = c[i - 16];
      }
      ASSERT_EQ(UnZigZag(differences.depths[i]), d[i] - depth) << x << ", " << y;
      ASSERT_EQ(UnZigZag(differences.colors[i]), c[i] - color) << x << ", " << y;
    }
  }
}

}  // namespace
}  // namespace isoscope::composite
