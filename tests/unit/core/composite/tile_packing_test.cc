#include "core/composite/tile_packing.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "core/composite/band_format.h"
#include "hwy/highway.h"
#include "hwy/targets.h"

namespace isoscope::composite {
namespace {

// A tile in the lower right corner of an image that is no multiple of tiles: planes end with it.
// The address sanitizer sees reads behind them in the portable kernels only.
struct TestTile {
  explicit TestTile(std::uint64_t tile_seed) : seed(tile_seed) {}

  [[nodiscard]] std::size_t plane_size() const { return (rows - 1) * stride + columns; }
  // Calls fn(place in the planes) for each covered pixel, in order: all of seed 0, else the more
  // the higher the seed.
  template <typename Fn>
  TileMask ForEachCovered(const Fn& fn) const {
    TileMask mask{};
    for (std::size_t y = 0; y < rows; ++y) {
      for (std::size_t x = 0; x < columns; ++x) {
        const std::size_t i = y * stride + x;
        if (seed == 0 || base::RandomUnit(seed + 2000, i) <= static_cast<double>(seed) / 100) {
          mask[y] = static_cast<std::uint16_t>(mask[y] | 1U << x);
          fn(i);
        }
      }
    }
    return mask;
  }

  const std::uint64_t seed;
  const std::size_t stride = 16 + seed % 7;
  const std::size_t columns = 1 + seed % kTilePx;
  const std::size_t rows = 1 + seed / 3 % kTilePx;
};

// Calls test(tile) for many tiles on every instruction set that the machine has.
template <typename Test>
void ForEachTileAndTarget(const Test& test) {
  const absl::Cleanup restore = [] { hwy::SetSupportedTargetsForTest(0); };
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    for (std::uint64_t seed = 0; seed < 100; ++seed) {
      SCOPED_TRACE(absl::StrCat(hwy::TargetName(target), ", seed ", seed));
      test(TestTile(seed));
    }
  }
}

TEST(TilePackingTest, CoveredPixelsComeInOrderOnEveryInstructionSet) {
  ForEachTileAndTarget([](const TestTile& tile) {
    std::vector<std::uint64_t> keys(tile.plane_size());
    std::vector<image::Rgba8> colors(keys.size());
    for (std::size_t i = 0; i < keys.size(); ++i) {
      keys[i] = base::RandomBits(tile.seed, i);
      colors[i] = ColorOf(static_cast<std::uint32_t>(base::RandomBits(tile.seed + 1000, i)));
    }
    std::vector<std::uint32_t> depths;
    std::vector<std::uint32_t> ids;
    std::vector<std::uint32_t> numbers;
    const TileMask mask = tile.ForEachCovered([&](std::size_t i) {
      depths.push_back(static_cast<std::uint32_t>(keys[i] >> 32));
      ids.push_back(static_cast<std::uint32_t>(keys[i]));
      numbers.push_back(std::uint32_t{colors[i].r} << 24 | std::uint32_t{colors[i].g} << 16 |
                        std::uint32_t{colors[i].b} << 8 | colors[i].a);
    });
    const std::size_t count = depths.size();
    ASSERT_EQ(PixelCount(mask), count);
    std::vector<std::uint32_t> packed_depths(count + kPackPadding);
    std::vector<std::uint32_t> packed_ids(count + kPackPadding);
    std::vector<std::uint32_t> packed_numbers(count + kPackPadding);
    PackKeys(mask, keys.data(), tile.stride, packed_depths.data(), packed_ids.data());
    PackColors(mask, colors.data(), tile.stride, packed_numbers.data());
    packed_depths.resize(count);
    packed_ids.resize(count);
    packed_numbers.resize(count);
    EXPECT_EQ(packed_depths, depths);
    EXPECT_EQ(packed_ids, ids);
    EXPECT_EQ(packed_numbers, numbers);
  });
}

TEST(TilePackingTest, OnlyNearerPixelsAreUnpackedOnEveryInstructionSet) {
  ForEachTileAndTarget([](const TestTile& tile) {
    // Few different keys: some equal, some with the highest bit set.
    const auto key_of = [](std::uint64_t of, std::uint64_t i) {
      return (base::RandomBits(of, i) & 3) << 62 | (base::RandomBits(of, i) >> 62);
    };
    std::vector<std::uint64_t> into_keys(tile.plane_size());
    std::vector<image::Rgba8> into_colors(into_keys.size());
    for (std::size_t i = 0; i < into_keys.size(); ++i) {
      into_keys[i] = key_of(tile.seed, i);
      into_colors[i] = ColorOf(static_cast<std::uint32_t>(i));
    }
    std::vector<std::uint64_t> expected_keys = into_keys;
    std::vector<image::Rgba8> expected_colors = into_colors;
    std::vector<std::uint64_t> keys;
    std::vector<image::Rgba8> colors;
    bool expects_ties = false;
    const TileMask mask = tile.ForEachCovered([&](std::size_t i) {
      keys.push_back(key_of(tile.seed + 1000, i));
      colors.push_back(ColorOf(static_cast<std::uint32_t>(i + 100000)));
      if (image::HaveEqualDepth(keys.back(), expected_keys[i])) {
        expects_ties = true;
      } else if (keys.back() < expected_keys[i]) {
        expected_keys[i] = keys.back();
        expected_colors[i] = colors.back();
      }
    });
    const bool has_ties = UnpackNearer(mask, keys.data(), colors.data(), tile.stride,
                                       into_keys.data(), into_colors.data());
    EXPECT_EQ(has_ties, expects_ties);
    EXPECT_EQ(into_keys, expected_keys);
    EXPECT_EQ(into_colors, expected_colors);
  });
}

TEST(TilePackingTest, TiesGoToTheFirstInTheOrder) {
  ForEachTileAndTarget([](const TestTile& tile) {
    const image::FragmentOrder order{.block_count = 4, .ties = image::TieRule::kColor};
    // One depth, few owners of two surfaces, few colours.
    const auto key_of = [](std::uint64_t of, std::uint64_t i) {
      return image::FragmentKey(0.5F, static_cast<std::uint32_t>(base::RandomBits(of, i) % 8));
    };
    const auto color_of = [](std::uint64_t of, std::uint64_t i) {
      return ColorOf(static_cast<std::uint32_t>(base::RandomBits(of + 7, i) % 3));
    };
    std::vector<std::uint64_t> into_keys(tile.plane_size());
    std::vector<image::Rgba8> into_colors(into_keys.size());
    for (std::size_t i = 0; i < into_keys.size(); ++i) {
      into_keys[i] = key_of(tile.seed, i);
      into_colors[i] = color_of(tile.seed, i);
    }
    std::vector<std::uint64_t> expected_keys = into_keys;
    std::vector<image::Rgba8> expected_colors = into_colors;
    std::vector<std::uint64_t> keys;
    std::vector<image::Rgba8> colors;
    const TileMask mask = tile.ForEachCovered([&](std::size_t i) {
      keys.push_back(key_of(tile.seed + 1000, i));
      colors.push_back(color_of(tile.seed + 1000, i));
      if (order.IsBefore(keys.back(), colors.back(), expected_keys[i], expected_colors[i])) {
        expected_keys[i] = keys.back();
        expected_colors[i] = colors.back();
      }
    });
    UnpackNearer(mask, keys.data(), colors.data(), tile.stride, into_keys.data(),
                 into_colors.data());
    SettleTies(mask, keys.data(), colors.data(), tile.stride, order, into_keys.data(),
               into_colors.data());
    EXPECT_EQ(into_keys, expected_keys);
    EXPECT_EQ(into_colors, expected_colors);
  });
}

}  // namespace
}  // namespace isoscope::composite
