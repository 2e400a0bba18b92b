#include "core/composite/tile_prediction.h"

#include <cstddef>
#include <cstdint>
#include <map>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "hwy/highway.h"
#include "hwy/targets.h"

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
    for (std::size_t at = 0; at < PixelCount(mask); ++at) {
      ASSERT_EQ(decoded.depths[at], numbers.depths[at]) << share << ", " << at;
      ASSERT_EQ(decoded.colors[at], numbers.colors[at]) << share << ", " << at;
    }
  }
}

// The table of docs/format/wire.md, pixel by pixel.
TEST(TilePredictionTest, PartOfATileIsExpectedAsTheFormatSaysOnEveryInstructionSet) {
  const absl::Cleanup restore = [] { hwy::SetSupportedTargetsForTest(0); };
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    TilePrediction prediction;
    std::uint32_t last_depth = 0;
    std::uint32_t last_color = 0;
    for (std::uint64_t seed = 1; seed < 200; ++seed) {
      const TileMask mask = MaskOf(base::RandomUnit(seed, 0), seed);
      const TileNumbers numbers = NumbersOf(1000 + seed);
      TileNumbers differences{};
      prediction.Subtract(mask, numbers, &differences);
      std::map<std::pair<int, int>, std::size_t> known;  // column, row: number of the pixel
      for (int y = 0; y < kTilePx; ++y) {
        for (int x = 0; x < kTilePx; ++x) {
          if ((mask[static_cast<std::size_t>(y)] >> x & 1) == 0) {
            continue;
          }
          const auto has = [&](int left, int up) { return known.contains({x - left, y - up}); };
          const auto depth = [&](int left, int up) {
            return numbers.depths[known.at({x - left, y - up})];
          };
          const auto color = [&](int left, int up) {
            return numbers.colors[known.at({x - left, y - up})];
          };
          std::uint32_t expected_depth = last_depth;
          std::uint32_t expected_color = last_color;
          if (has(1, 0) && has(0, 1) && has(1, 1)) {
            expected_depth = depth(1, 0) + depth(0, 1) - depth(1, 1);
            expected_color = color(1, 0) + color(0, 1) - color(1, 1);
          } else if (has(1, 0)) {
            expected_depth = has(2, 0) ? 2 * depth(1, 0) - depth(2, 0) : depth(1, 0);
            expected_color = color(1, 0);
          } else if (has(0, 1)) {
            expected_depth = has(0, 2) ? 2 * depth(0, 1) - depth(0, 2) : depth(0, 1);
            expected_color = color(0, 1);
          }
          const std::size_t i = known.size();
          known[{x, y}] = i;
          last_depth = numbers.depths[i];
          last_color = numbers.colors[i];
          ASSERT_EQ(UnZigZag(differences.depths[i]), last_depth - expected_depth)
              << hwy::TargetName(target) << ": tile " << seed << ", " << x << ", " << y;
          ASSERT_EQ(UnZigZag(differences.colors[i]), last_color - expected_color)
              << hwy::TargetName(target) << ": tile " << seed << ", " << x << ", " << y;
        }
      }
    }
  }
}

// The same, read off for one tile with every pixel covered.
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
