#include "core/mesh/mesh_welder.h"

#include <cstdint>
#include <utility>
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

BlockMesh MakeBlock(volume::BlockId id, const std::vector<math::Vec3f>& positions,
                    const std::vector<std::uint32_t>& indices) {
  BlockMesh block;
  block.block_id = id;
  block.positions = positions;
  for (const math::Vec3f& position : positions) {
    block.normals.push_back({0, position.x, 0});
  }
  block.indices = indices;
  return block;
}

TEST(MeshWelderTest, SharedVertexIsGivenOnceAndKeepsItsNumber) {
  MeshWelder welder(MakeLayout());
  WeldedPart part;
  welder.Add(MakeBlock(0, {{1, 0.5F, 0}, {2, 0.5F, 0}, {2, 1, 0.25F}}, {0, 1, 2}), &part);
  EXPECT_EQ(part.first_vertex, 0);
  EXPECT_EQ(part.positions.size(), 3U);
  EXPECT_THAT(part.triangles, ElementsAre(0, 1, 2));
  welder.Add(MakeBlock(1, {{2, 1, 0.25F}, {3.5F, 0, 0}, {2, 0.5F, 0}}, {2, 0, 1}), &part);
  EXPECT_EQ(part.first_vertex, 3);
  ASSERT_EQ(part.positions.size(), 1U);
  EXPECT_EQ(part.positions[0].x, 3.5F);
  EXPECT_EQ(part.normals[0].y, 3.5F);
  EXPECT_THAT(part.triangles, ElementsAre(1, 2, 3));
  EXPECT_EQ(welder.vertex_count(), 4);
}

TEST(MeshWelderTest, VerticesOfOnePlaceAndOtherCopiesStayApart) {
  MeshWelder welder(MakeLayout());
  WeldedPart part;
  BlockMesh first = MakeBlock(0, {{2, 1, 1}, {2, 1, 1}, {1, 1, 0.5F}}, {0, 1, 2});
  first.copies = {0, 1, 0};
  welder.Add(first, &part);
  EXPECT_EQ(part.positions.size(), 3U);
  BlockMesh second = MakeBlock(1, {{2, 1, 1}, {2, 1, 1}, {2, 1, 1}}, {0, 1, 2});
  second.copies = {1, 2, 0};
  welder.Add(second, &part);
  EXPECT_EQ(part.positions.size(), 1U);
  EXPECT_THAT(part.triangles, ElementsAre(1, 3, 0));
}

// A block without copy numbers has copies 0.
TEST(MeshWelderTest, AMissingCopyNumberIsZero) {
  MeshWelder welder(MakeLayout());
  WeldedPart part;
  BlockMesh first = MakeBlock(0, {{2, 1, 1}, {2, 1, 1}, {1, 1, 0.5F}}, {0, 1, 2});
  first.copies = {1, 0, 0};
  welder.Add(first, &part);
  welder.Add(MakeBlock(1, {{2, 1, 1}, {3, 1, 0.5F}, {4, 1, 0.5F}}, {0, 1, 2}), &part);
  EXPECT_THAT(part.triangles, ElementsAre(1, 3, 4));
}

TEST(MeshWelderTest, MinusZeroIsZero) {
  MeshWelder welder(MakeLayout());
  WeldedPart part;
  welder.Add(MakeBlock(0, {{2, -0.0F, 0}, {2, 1, -0.0F}, {1, 0, 0}}, {0, 1, 2}), &part);
  welder.Add(MakeBlock(1, {{2, 0, -0.0F}, {2, 1, 0}, {3, 0, 0}}, {0, 1, 2}), &part);
  EXPECT_THAT(part.triangles, ElementsAre(0, 1, 3));
}

// Only the plane x = 2 lies between blocks: the ends of the volume do not, though they are
// multiples of 2 as well.
TEST(MeshWelderTest, OnlyVerticesBetweenBlocksAreLookedUp) {
  const std::vector<math::Vec3f> alone = {{1, 0.5F, 1}, {0, 2, 0}, {4, 2, 2}, {1.5F, 1, 1}};
  for (const math::Vec3f& position : alone) {
    MeshWelder welder(MakeLayout());
    WeldedPart part;
    welder.Add(MakeBlock(0, {position}, {}), &part);
    welder.Add(MakeBlock(1, {position}, {}), &part);
    EXPECT_EQ(part.positions.size(), 1U) << position.x << " " << position.y << " " << position.z;
  }
}

TEST(MeshWelderTest, EmptyBlockAddsNothing) {
  MeshWelder welder(MakeLayout());
  WeldedPart part;
  welder.Add(MakeBlock(0, {{2, 0.5F, 0}, {2, 1, 0.5F}, {0.5F, 0, 0}}, {0, 1, 2}), &part);
  welder.Add(MakeBlock(1, {}, {}), &part);
  EXPECT_EQ(part.first_vertex, 3);
  EXPECT_THAT(part.positions, IsEmpty());
  EXPECT_THAT(part.normals, IsEmpty());
  EXPECT_THAT(part.triangles, IsEmpty());
}

TEST(MeshWelderTest, WeldJoinsBlocksToOneMesh) {
  const std::vector<BlockMesh> blocks{
      MakeBlock(0, {{1, 0.5F, 0}, {2, 0.5F, 0}, {2, 1, 0.5F}}, {0, 1, 2}),
      MakeBlock(1, {{2, 1, 0.5F}, {3.5F, 0, 0}, {2, 0.5F, 0}}, {2, 1, 0})};
  const testing::WeldedMesh mesh = testing::Weld(MakeLayout(), blocks);
  EXPECT_EQ(mesh.positions.size(), 4U);
  EXPECT_EQ(mesh.normals.size(), 4U);
  EXPECT_THAT(mesh.triangles, ElementsAre(0, 1, 2, 1, 3, 2));
}

TEST(MeshWelderDeathTest, CopyNumbersOfOtherVerticesAreRefused) {
  BlockMesh block = MakeBlock(0, {{0.5F, 0, 0}, {0.5F, 1, 0}}, {});
  block.copies = {1};
  MeshWelder welder(MakeLayout());
  WeldedPart part;
  EXPECT_DEATH(welder.Add(block, &part), "copies");
}

}  // namespace
}  // namespace isoscope::mesh
