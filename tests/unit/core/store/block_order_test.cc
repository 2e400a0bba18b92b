#include "core/store/block_order.h"

#include <algorithm>
#include <cstdint>
#include <set>
#include <vector>

#include "gtest/gtest.h"

namespace isoscope::store {
namespace {

constexpr math::Index3 kDims{9, 7, 6};  // blocks: cubes cut on every axis

volume::BlockLayout Layout() {
  return volume::BlockLayout::Make({kDims.x + 1, kDims.y + 1, kDims.z + 1}, {1, 1, 1}).value();
}

std::vector<math::Index3> InOrder(const math::IndexBox& box) {
  std::vector<math::Index3> blocks;
  for (BlocksInOrder it(box); !it.is_at_end(); it.Next()) {
    blocks.push_back(it.index());
  }
  return blocks;
}

const std::vector<math::IndexBox>& Boxes() {
  static const auto* const boxes =
      new std::vector<math::IndexBox>{{.begin = {}, .end = kDims},
                                      {.begin = {0, 0, 2}, .end = {9, 7, 4}},
                                      {.begin = {0, 3, 5}, .end = {9, 5, 6}},
                                      {.begin = {5, 1, 1}, .end = {6, 2, 2}},
                                      {.begin = {2, 2, 2}, .end = {9, 7, 6}}};
  return *boxes;
}

TEST(BlockOrderTest, OneCubeIsAPathThatEndsBesideTheNext) {
  const std::vector<math::Index3> cube = InOrder({.begin = {}, .end = {4, 4, 4}});
  ASSERT_EQ(cube.size(), 64u);
  for (std::size_t i = 1; i < cube.size(); ++i) {
    const math::Index3 step = cube[i] - cube[i - 1];
    EXPECT_EQ(step.x * step.x + step.y * step.y + step.z * step.z, 1) << "place " << i;
  }
  EXPECT_EQ(cube.front(), (math::Index3{0, 0, 0}));
  EXPECT_EQ(cube.back(), (math::Index3{3, 0, 0}));
  // Known values: files must not change between versions without need.
  EXPECT_EQ(cube[1], (math::Index3{0, 1, 0}));
  EXPECT_EQ(cube[31], (math::Index3{1, 2, 0}));
  EXPECT_EQ(cube[32], (math::Index3{2, 2, 0}));
}

TEST(BlockOrderTest, CubesFollowOneAnotherAlongXThenYThenZ) {
  const std::vector<math::Index3> blocks = InOrder({.begin = {}, .end = {8, 8, 8}});
  ASSERT_EQ(blocks.size(), 512u);
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    const auto cube = static_cast<std::int64_t>(i / 64);
    EXPECT_EQ(blocks[i].x / 4, cube % 2);
    EXPECT_EQ(blocks[i].y / 4, cube / 2 % 2);
    EXPECT_EQ(blocks[i].z / 4, cube / 4);
  }
}

TEST(BlockOrderTest, ABoxIsVisitedWholeInTheOrderOfTheKeys) {
  const volume::BlockLayout layout = Layout();
  for (const math::IndexBox& box : Boxes()) {
    std::vector<volume::BlockId> expected;
    for (volume::BlockId id = 0; id < layout.block_count(); ++id) {
      if (box.Contains(layout.IndexOf(id))) {
        expected.push_back(id);
      }
    }
    std::sort(expected.begin(), expected.end(), [&](volume::BlockId a, volume::BlockId b) {
      return BlockOrderKey(layout, a) < BlockOrderKey(layout, b);
    });
    std::vector<volume::BlockId> visited;
    for (const math::Index3& index : InOrder(box)) {
      visited.push_back(layout.IdOf(index));
    }
    EXPECT_EQ(visited, expected);
  }
}

TEST(BlockOrderTest, NoTwoBlocksShareAKey) {
  const volume::BlockLayout layout = Layout();
  std::set<std::uint64_t> keys;
  for (volume::BlockId id = 0; id < layout.block_count(); ++id) {
    EXPECT_TRUE(keys.insert(BlockOrderKey(layout, id)).second);
  }
  // As long as it is thin.
  const auto line = volume::BlockLayout::Make({(std::int64_t{1} << 31) + 1, 2, 2}, {1, 1, 1});
  ASSERT_TRUE(line.ok());
  EXPECT_EQ(BlockOrderKey(*line, (1U << 31) - 1), ((std::uint64_t{1} << 29) - 1) * 64 + 63);
}

TEST(BlockOrderTest, RanksCountTheBlocksBefore) {
  for (const math::IndexBox& box : Boxes()) {
    const std::vector<math::Index3> blocks = InOrder(box);
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      EXPECT_EQ(RankInBox(box, blocks[i]), static_cast<std::int64_t>(i));
    }
  }
}

}  // namespace
}  // namespace isoscope::store
