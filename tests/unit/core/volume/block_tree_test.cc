// Trees of random sets are compared with the sets: members, order, distances by trying all bricks,
// unions, filters. Volumes whose blocks do not fill their bricks, flat and long ones.

#include "core/volume/block_tree.h"

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/random.h"

namespace isoscope::volume {
namespace {

constexpr math::Index3 kVolumes[] = {{1, 1, 1},  {4, 4, 4},   {5, 4, 9},   {33, 18, 7},
                                     {70, 1, 1}, {1, 40, 50}, {24, 24, 24}};

BlockSet RandomSet(const math::Index3& dims, double share, std::uint64_t seed) {
  BlockSet set(math::Volume(dims));
  for (std::int64_t id = 0; id < math::Volume(dims); ++id) {
    if (base::RandomUnit(seed, static_cast<std::uint64_t>(id)) < share) {
      set.Insert(static_cast<BlockId>(id));
    }
  }
  return set;
}

TEST(BlockTreeTest, HasTheMembersOfItsSet) {
  for (const math::Index3& dims : kVolumes) {
    for (const double share : {0.0, 0.01, 0.3, 1.0}) {
      const BlockSet set = RandomSet(dims, share, 3);
      const BlockTree tree(dims, set);
      EXPECT_EQ(tree.count(), set.Count());
      EXPECT_EQ(tree.Ids(), set.Ids()) << dims.x << " " << dims.y << " " << dims.z;
      EXPECT_EQ(tree.ToSet(), set);
      for (std::int64_t id = 0; id < math::Volume(dims); ++id) {
        const auto block = static_cast<BlockId>(id);
        ASSERT_EQ(tree.Contains(block), set.Contains(block)) << id;
      }
    }
  }
}

TEST(BlockTreeTest, BricksInAnyOrderMakeTheSameTree) {
  const math::Index3 dims{33, 18, 7};
  const BlockTree tree(dims, RandomSet(dims, 0.1, 5));
  std::vector<BlockTree::Brick> bricks;
  for (std::size_t i = tree.words().size(); i-- > 0;) {
    bricks.push_back({tree.bricks()[i], tree.words()[i]});
  }
  std::swap(bricks.front(), bricks[bricks.size() / 2]);
  EXPECT_EQ(BlockTree(dims, bricks), tree);
}

TEST(BlockTreeTest, EmptyBricksKnowTheDistanceToTheNextOneWithMembers) {
  for (const math::Index3& dims : kVolumes) {
    for (const double share : {0.0, 0.0005, 0.005, 0.05}) {
      const BlockTree tree(dims, RandomSet(dims, share, 8));
      const math::Index3& bricks = tree.brick_dims();
      const auto at = [&](std::int64_t index) {
        return math::Index3{index % bricks.x, index / bricks.x % bricks.y,
                            index / (bricks.x * bricks.y)};
      };
      for (std::int64_t i = 0; i < math::Volume(bricks); ++i) {
        const std::uint32_t cell = tree.cells()[static_cast<std::size_t>(i)];
        if (cell < BlockTree::kEmpty) {
          ASSERT_EQ(tree.bricks()[cell], i);
          ASSERT_NE(tree.words()[cell], 0U);
          continue;
        }
        std::int64_t expected = std::max({bricks.x, bricks.y, bricks.z});
        for (const std::uint32_t other : tree.bricks()) {
          const math::Index3 offset = at(i) - at(other);
          expected = std::min(
              expected, std::max({std::abs(offset.x), std::abs(offset.y), std::abs(offset.z)}));
        }
        ASSERT_EQ(cell - BlockTree::kEmpty, expected) << "brick " << i;
      }
    }
  }
}

TEST(BlockTreeTest, MarksAreASubset) {
  const math::Index3 dims{33, 18, 7};
  const BlockSet set = RandomSet(dims, 0.2, 1);
  const BlockTree tree(dims, set);
  std::vector<std::uint64_t> marks(tree.words().begin(), tree.words().end());
  BlockSet some = RandomSet(dims, 0.4, 2);
  for (std::size_t i = 0; i < marks.size(); ++i) {
    for (int bit = 0; bit < 64; ++bit) {
      const math::Index3 index = tree.IndexOf(tree.bricks()[i], bit);
      if (index.x >= dims.x || index.y >= dims.y || index.z >= dims.z) {
        ASSERT_EQ(marks[i] >> bit & 1, 0U) << "a block outside the volume";
        continue;
      }
      const auto id = static_cast<BlockId>(index.x + dims.x * (index.y + dims.y * index.z));
      ASSERT_EQ(tree.CodeOf(index), tree.CodeOf(id));
      if (!some.Contains(id)) {
        marks[i] &= ~(std::uint64_t{1} << bit);
      }
    }
  }
  some.IntersectWith(set);
  EXPECT_EQ(tree.IdsOf(marks), some.Ids());
}

TEST(BlockTreeTest, NeighboursOfMarksAreThoseInAllDirections) {
  for (const math::Index3& dims : kVolumes) {
    const BlockSet set = RandomSet(dims, 0.3, 1);
    const BlockTree tree(dims, set);
    const BlockSet marked = RandomSet(dims, 0.05, 2);
    std::vector<std::uint64_t> marks(tree.words().size());
    BlockSet expected(math::Volume(dims));
    for (const BlockId id : set.Ids()) {
      if (!marked.Contains(id)) {
        continue;
      }
      const std::int64_t code = tree.CodeOf(id);
      marks[tree.cells()[static_cast<std::size_t>(code >> 6)]] |= std::uint64_t{1} << (code & 63);
      const math::Index3 at{id % dims.x, id / dims.x % dims.y, id / (dims.x * dims.y)};
      for (std::int64_t other = 0; other < math::Volume(dims); ++other) {
        const math::Index3 offset =
            math::Index3{other % dims.x, other / dims.x % dims.y, other / (dims.x * dims.y)} - at;
        if (std::max({std::abs(offset.x), std::abs(offset.y), std::abs(offset.z)}) <= 1) {
          expected.Insert(static_cast<BlockId>(other));
        }
      }
    }
    expected.IntersectWith(set);
    EXPECT_EQ(tree.IdsOf(tree.WithNeighbours(marks)), expected.Ids())
        << dims.x << " " << dims.y << " " << dims.z;
  }
}

TEST(BlockTreeTest, UnionsAndFiltersAreThoseOfSets) {
  const math::Index3 dims{33, 18, 7};
  const BlockSet a = RandomSet(dims, 0.02, 1);
  const BlockSet b = RandomSet(dims, 0.03, 2);
  const BlockSet c = RandomSet(dims, 0, 2);
  const BlockTree trees[] = {BlockTree(dims, a), BlockTree(dims, b), BlockTree(dims, c)};
  const BlockTree* const all[] = {&trees[0], &trees[1], &trees[2]};
  BlockSet united = a;
  united.UnionWith(b);
  EXPECT_EQ(BlockTree::Union(all), BlockTree(dims, united));

  BlockSet lower(math::Volume(dims));
  for (const BlockId id : a.Ids()) {
    if (id % dims.x < 16) {
      lower.Insert(id);
    }
  }
  EXPECT_EQ(trees[0].Filtered([](const math::Index3& index) { return index.x < 16; }),
            BlockTree(dims, lower));
}

TEST(BlockTreeDeathTest, BricksOfAnotherVolumeAreRefused) {
  const BlockTree::Brick brick{8, 1};
  EXPECT_DEATH(BlockTree({8, 8, 8}, absl::MakeConstSpan(&brick, 1)), "cells_.size");
}

}  // namespace
}  // namespace isoscope::volume
