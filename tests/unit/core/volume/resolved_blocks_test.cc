// Resolved blocks against brute force: intervals of real numbers on the axes of level 0, cell by
// cell of the level, block by block. And what is meant: a vessel of one voxel is unresolved.

#include "core/volume/resolved_blocks.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <thread>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/random.h"
#include "core/volume/block_layout.h"

namespace isoscope::volume {
namespace {

using math::Index3;

// Samples of a level: level 0, or means of those of the level before.
struct Samples {
  Index3 dims;
  std::vector<double> values;

  [[nodiscard]] double At(const Index3& p) const {
    return values[static_cast<std::size_t>(p.x + dims.x * (p.y + dims.y * p.z))];
  }
  [[nodiscard]] std::vector<Index3> ActiveCells(double isovalue) const {
    std::vector<Index3> cells;
    for (std::int64_t z = 0; z + 1 < dims.z; ++z) {
      for (std::int64_t y = 0; y + 1 < dims.y; ++y) {
        for (std::int64_t x = 0; x + 1 < dims.x; ++x) {
          int inside = 0;
          for (std::int64_t k = 0; k < 8; ++k) {
            inside += At({x + (k & 1), y + (k >> 1 & 1), z + (k >> 2)}) >= isovalue ? 1 : 0;
          }
          if (inside > 0 && inside < 8) {
            cells.push_back({x, y, z});
          }
        }
      }
    }
    return cells;
  }
};

Samples NextLevel(const Samples& fine) {
  Samples coarse{.dims = {fine.dims.x / 2, fine.dims.y / 2, fine.dims.z / 2}, .values = {}};
  for (std::int64_t z = 0; z < coarse.dims.z; ++z) {
    for (std::int64_t y = 0; y < coarse.dims.y; ++y) {
      for (std::int64_t x = 0; x < coarse.dims.x; ++x) {
        double sum = 0;
        for (std::int64_t k = 0; k < 8; ++k) {
          sum += fine.At({2 * x + (k & 1), 2 * y + (k >> 1 & 1), 2 * z + (k >> 2)});
        }
        coarse.values.push_back(sum / 8);
      }
    }
  }
  return coarse;
}

Samples Noise(const Index3& dims, std::uint64_t seed, double inside_share) {
  Samples samples{.dims = dims, .values = {}};
  for (std::int64_t i = 0; i < math::Volume(dims); ++i) {
    samples.values.push_back(
        base::RandomUnit(seed, static_cast<std::uint64_t>(i)) < inside_share ? 100 : 0);
  }
  return samples;
}

BlockTree ActiveBlocksOf(const Samples& samples, const BlockLayout& layout, double isovalue) {
  BlockSet active(layout.block_count());
  for (std::int64_t i = 0; i < layout.block_count(); ++i) {
    const auto id = static_cast<BlockId>(i);
    const math::IndexBox own = layout.OwnSamplesOf(id);
    double min = INFINITY;
    double max = -INFINITY;
    for (std::int64_t z = own.begin.z; z < own.end.z; ++z) {
      for (std::int64_t y = own.begin.y; y < own.end.y; ++y) {
        for (std::int64_t x = own.begin.x; x < own.end.x; ++x) {
          min = std::min(min, samples.At({x, y, z}));
          max = std::max(max, samples.At({x, y, z}));
        }
      }
    }
    if (min < isovalue && isovalue <= max) {
      active.Insert(id);
    }
  }
  return {layout.block_dims(), active};
}

// Whether a cell of the level and a block of level 0 have a volume in common, by real numbers.
bool Overlaps(const Index3& cell, int level, const math::IndexBox& cells) {
  const double size = std::exp2(level);
  bool overlaps = true;
  for (int axis = 0; axis < 3; ++axis) {
    const double begin = (size - 1) / 2 + static_cast<double>(cell[axis]) * size;
    overlaps = overlaps && begin < static_cast<double>(cells.end[axis]) &&
               begin + size > static_cast<double>(cells.begin[axis]);
  }
  return overlaps;
}

TEST(ResolvedBlocksTest, TheyAreThoseThatACellWithATriangleOverlaps) {
  int resolved_count = 0;
  int unresolved_count = 0;
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    const auto draw = [&](std::uint64_t i, int low, int high) {
      return low + static_cast<int>(base::RandomBits(1000 + seed, i) %
                                    static_cast<std::uint64_t>(high - low + 1));
    };
    const Index3 dims{draw(0, 8, 30), draw(1, 8, 30), draw(2, 8, 30)};
    const Samples fine = Noise(dims, seed, seed % 2 == 0 ? 0.02 : 0.4);
    const auto layout =
        BlockLayout::Make(dims, {draw(3, 1, 6), draw(4, 1, 6), draw(5, 1, 6)}).value();
    const double isovalue = 10.0 * draw(6, 1, 9);
    const BlockTree active = ActiveBlocksOf(fine, layout, isovalue);
    Samples coarse = fine;
    for (int level = 1; level <= 2; ++level) {
      coarse = NextLevel(coarse);
      const std::vector<Index3> cells = coarse.ActiveCells(isovalue);
      ResolvedBlocks resolved(layout, &active, level);
      for (const Index3& cell : cells) {
        resolved.AddCell(cell);
      }
      std::vector<BlockId> expected_ids;
      for (std::int64_t i = 0; i < layout.block_count(); ++i) {
        const auto id = static_cast<BlockId>(i);
        const bool expected = std::any_of(cells.begin(), cells.end(), [&](const Index3& cell) {
          return Overlaps(cell, level, layout.CellsOf(id));
        });
        if (active.Contains(id) && expected) {
          expected_ids.push_back(id);
        }
        unresolved_count += active.Contains(id) && !expected ? 1 : 0;
      }
      EXPECT_EQ(resolved.Ids(), expected_ids) << "seed " << seed << ", level " << level;
      resolved_count += static_cast<int>(expected_ids.size());
    }
  }
  EXPECT_GT(resolved_count, 500);
  EXPECT_GT(unresolved_count, 100);
}

// Reading fewer blocks of the level changes nothing that counts.
TEST(ResolvedBlocksTest, OnlyBlocksOverActiveOnesNeedToBeRead) {
  std::int64_t left_out = 0;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const Index3 dims{25, 22, 27};
    const Samples fine = Noise(dims, seed, 0.003);
    const auto fine_layout = BlockLayout::Make(dims, {3, 4, 2}).value();
    const Samples coarse = NextLevel(fine);
    const auto coarse_layout = BlockLayout::Make(coarse.dims, {2, 2, 3}).value();
    const BlockTree fine_active = ActiveBlocksOf(fine, fine_layout, 60);
    const BlockSet coarse_active = ActiveBlocksOf(coarse, coarse_layout, 10).ToSet();
    const BlockSet chosen =
        BlocksThatMayResolve(coarse_layout, coarse_active, 1, fine_layout, fine_active);
    ResolvedBlocks all(fine_layout, &fine_active, 1);
    ResolvedBlocks some(fine_layout, &fine_active, 1);
    for (std::int64_t i = 0; i < coarse_layout.block_count(); ++i) {
      const auto id = static_cast<BlockId>(i);
      ASSERT_TRUE(coarse_active.Contains(id) || !chosen.Contains(id));
      left_out += coarse_active.Contains(id) && !chosen.Contains(id) ? 1 : 0;
      for (const Index3& cell : coarse.ActiveCells(10)) {
        if (!coarse_layout.CellsOf(id).Contains(cell)) {
          continue;
        }
        all.AddCell(cell);
        if (chosen.Contains(id)) {
          some.AddCell(cell);
        }
      }
    }
    EXPECT_EQ(some.Ids(), all.Ids());
  }
  EXPECT_EQ(left_out, 0) << "a mean above 0 lies over an active block";
  // Without active blocks none needs to be read.
  const auto fine_layout = BlockLayout::Make({25, 22, 27}, {3, 4, 2}).value();
  const auto coarse_layout = BlockLayout::Make({12, 11, 13}, {2, 2, 3}).value();
  BlockSet coarse_active(coarse_layout.block_count());
  coarse_active.Insert(5);
  EXPECT_EQ(BlocksThatMayResolve(coarse_layout, coarse_active, 1, fine_layout,
                                 {fine_layout.block_dims(), BlockSet(fine_layout.block_count())})
                .Count(),
            0);
}

TEST(ResolvedBlocksTest, ALoneVesselOfOneVoxelIsUnresolvedAndAThickOneIsNot) {
  const Index3 dims{33, 33, 33};
  const auto layout = BlockLayout::Make(dims, {8, 8, 8}).value();
  for (const std::int64_t thickness : {1, 6}) {
    Samples fine{.dims = dims, .values = {}};
    for (std::int64_t z = 0; z < dims.z; ++z) {
      for (std::int64_t y = 0; y < dims.y; ++y) {
        for (std::int64_t x = 0; x < dims.x; ++x) {
          const bool is_vessel = y >= 10 && y < 10 + thickness && z >= 10 && z < 10 + thickness;
          fine.values.push_back(is_vessel ? 100 : 0);
        }
      }
    }
    const BlockTree active = ActiveBlocksOf(fine, layout, 60);
    EXPECT_EQ(active.count(), 4) << "the blocks along x";
    ResolvedBlocks resolved(layout, &active, 1);
    for (const Index3& cell : NextLevel(fine).ActiveCells(60)) {
      resolved.AddCell(cell);
    }
    EXPECT_EQ(resolved.Ids(), thickness == 1 ? std::vector<BlockId>() : active.Ids());
  }
}

TEST(ResolvedBlocksTest, ACellLiesOverTheCellsThatItsSamplesAreTheCentresOf) {
  // Level 1: samples at 0.5 and 2.5. Level 3: at 3.5 and 11.5.
  EXPECT_EQ(CellsUnder({40, 40, 40}, 1, {0, 1, 2}), (math::IndexBox{{0, 2, 4}, {3, 5, 7}}));
  EXPECT_EQ(CellsUnder({40, 40, 40}, 3, {0, 1, 3}), (math::IndexBox{{3, 11, 27}, {12, 20, 36}}));
}

TEST(ResolvedBlocksTest, ManyThreadsAddCells) {
  const auto layout = BlockLayout::Make({65, 65, 65}, {3, 3, 3}).value();
  BlockSet all(layout.block_count());
  for (std::int64_t i = 0; i < layout.block_count(); ++i) {
    if (i % 3 != 0) {
      all.Insert(static_cast<BlockId>(i));
    }
  }
  const BlockTree active(layout.block_dims(), all);
  ResolvedBlocks one(layout, &active, 1);
  ResolvedBlocks many(layout, &active, 1);
  const auto add = [](std::int64_t first, std::int64_t step, ResolvedBlocks* to) {
    for (std::int64_t i = first; i < 30 * 30 * 30; i += step) {
      if (base::RandomBits(3, static_cast<std::uint64_t>(i)) % 4 == 0) {
        to->AddCell({i % 30, i / 30 % 30, i / 900});
      }
    }
  };
  add(0, 1, &one);
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&, i] { add(i, 4, &many); });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_GT(one.Ids().size(), 1000U);
  EXPECT_EQ(many.Ids(), one.Ids());
}

}  // namespace
}  // namespace isoscope::volume
