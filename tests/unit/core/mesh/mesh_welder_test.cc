#include "core/mesh/mesh_welder.h"

#include <cstdint>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/mesh_metrics.h"

namespace isoscope::mesh {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

// 5 x 3 x 3 samples in two blocks of 2 x 2 x 2 cells: the plane x = 2 is shared.
volume::BlockLayout MakeLayout() { return volume::BlockLayout::Make({5, 3, 3}, {2, 2, 2}).value(); }

std::int64_t Key(std::int64_t x, std::int64_t y, std::int64_t z, std::int64_t axis) {
  return 3 * (x + 5 * (y + 3 * z)) + axis;
}

BlockMesh MakeBlock(volume::BlockId id, const std::vector<std::int64_t>& keys,
                    const std::vector<std::uint32_t>& indices) {
  BlockMesh block;
  block.block_id = id;
  block.edge_keys = keys;
  for (const std::int64_t key : keys) {
    block.positions.push_back({static_cast<float>(key), 0, 0});
    block.normals.push_back({0, static_cast<float>(key), 0});
  }
  block.indices = indices;
  return block;
}

TEST(MeshWelderTest, SharedVertexIsGivenOnceAndKeepsItsNumber) {
  MeshWelder welder(MakeLayout());
  WeldedPart part;
  welder.Add(MakeBlock(0, {Key(1, 0, 0, 1), Key(2, 0, 0, 1), Key(2, 1, 0, 2)}, {0, 1, 2}), &part);
  EXPECT_EQ(part.first_vertex, 0);
  EXPECT_EQ(part.positions.size(), 3U);
  EXPECT_THAT(part.triangles, ElementsAre(0, 1, 2));
  welder.Add(MakeBlock(1, {Key(2, 1, 0, 2), Key(3, 0, 0, 1), Key(2, 0, 0, 1)}, {2, 0, 1}), &part);
  EXPECT_EQ(part.first_vertex, 3);
  ASSERT_EQ(part.positions.size(), 1U);
  EXPECT_EQ(part.positions[0].x, static_cast<float>(Key(3, 0, 0, 1)));
  EXPECT_EQ(part.normals[0].y, static_cast<float>(Key(3, 0, 0, 1)));
  EXPECT_THAT(part.triangles, ElementsAre(1, 2, 3));
  EXPECT_EQ(welder.vertex_count(), 4);
}

// x = 2 is shared, but an edge along x that starts there is inside the second block.
TEST(MeshWelderTest, EdgeThatLeavesASharedFaceIsNotOnIt) {
  MeshWelder welder(MakeLayout());
  WeldedPart part;
  welder.Add(MakeBlock(0, {Key(1, 0, 0, 0), Key(1, 1, 0, 0), Key(1, 0, 1, 0)}, {0, 1, 2}), &part);
  welder.Add(MakeBlock(1, {Key(2, 0, 0, 0), Key(2, 1, 0, 0), Key(2, 0, 1, 0)}, {0, 1, 2}), &part);
  EXPECT_THAT(part.triangles, ElementsAre(3, 4, 5));
}

TEST(MeshWelderTest, EmptyBlockAddsNothing) {
  MeshWelder welder(MakeLayout());
  WeldedPart part;
  welder.Add(MakeBlock(0, {Key(2, 0, 0, 1), Key(2, 1, 0, 2), Key(0, 0, 0, 0)}, {0, 1, 2}), &part);
  welder.Add(MakeBlock(1, {}, {}), &part);
  EXPECT_EQ(part.first_vertex, 3);
  EXPECT_THAT(part.positions, IsEmpty());
  EXPECT_THAT(part.normals, IsEmpty());
  EXPECT_THAT(part.triangles, IsEmpty());
}

TEST(MeshWelderTest, WeldJoinsBlocksToOneMesh) {
  const std::vector<BlockMesh> blocks{
      MakeBlock(0, {Key(1, 0, 0, 1), Key(2, 0, 0, 1), Key(2, 1, 0, 2)}, {0, 1, 2}),
      MakeBlock(1, {Key(2, 1, 0, 2), Key(3, 0, 0, 1), Key(2, 0, 0, 1)}, {2, 1, 0})};
  const testing::WeldedMesh mesh = testing::Weld(MakeLayout(), blocks);
  EXPECT_EQ(mesh.positions.size(), 4U);
  EXPECT_EQ(mesh.normals.size(), 4U);
  EXPECT_THAT(mesh.triangles, ElementsAre(0, 1, 2, 1, 3, 2));
}

TEST(MeshWelderDeathTest, MeshWithoutEdgeKeysIsRefused) {
  BlockMesh block = MakeBlock(0, {Key(0, 0, 0, 0)}, {});
  block.edge_keys.clear();
  MeshWelder welder(MakeLayout());
  WeldedPart part;
  EXPECT_DEATH(welder.Add(block, &part), "edge_keys");
}

}  // namespace
}  // namespace isoscope::mesh
