// Blocks as an agent may send them. Streams and replicas: isosurface_service_test, and
// tests/integration/replica_test.cc.

#include "server/frame/surface_stream.h"

#include <cmath>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::server {
namespace {

namespace internal = isoscope::internal::v1;
using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

template <typename T>
std::string Bytes(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

// A grid of 5 x 5 x 5 samples, 8 blocks.
volume::BlockLayout Layout() { return volume::BlockLayout::Make({5, 5, 5}, {2, 2, 2}).value(); }

// One triangle in block 3.
internal::BlockSurface MakeBlock() {
  internal::BlockSurface block;
  block.set_block_id(3);
  block.set_positions(Bytes<float>({0, 0, 0, 1, 0, 0, 0, 1, 0}));
  block.set_normals(Bytes<float>({0, 0, 1, 0, 0, 1, 0, 0, 1}));
  block.set_copies(Bytes<std::uint8_t>({0, 7, 255}));
  block.set_triangles(Bytes<std::uint32_t>({0, 1, 2}));
  return block;
}

TEST(SurfaceStreamTest, ABlockIsUnpackedAsItWasSent) {
  mesh::BlockMesh mesh;
  ISOSCOPE_ASSERT_OK(UnpackBlock(MakeBlock(), Layout(), &mesh));
  EXPECT_EQ(mesh.block_id, 3U);
  ASSERT_EQ(mesh.positions.size(), 3U);
  EXPECT_EQ(mesh.positions[2], (math::Vec3f{0, 1, 0}));
  EXPECT_EQ(mesh.normals[2], (math::Vec3f{0, 0, 1}));
  EXPECT_EQ(mesh.copies, (std::vector<std::uint8_t>{0, 7, 255}));
  EXPECT_EQ(mesh.indices, (std::vector<std::uint32_t>{0, 1, 2}));
}

TEST(SurfaceStreamTest, BlocksThatWouldBeReadOutOfBoundsAreRefused) {
  struct Case {
    void (*change)(internal::BlockSurface*);
    const char* error;
  };
  const Case cases[] = {
      {[](auto* b) { b->set_block_id(-1); }, "block_id is -1: must lie in [0, 8)"},
      {[](auto* b) { b->set_block_id(8); }, "block_id is 8"},
      {[](auto* b) { b->mutable_positions()->pop_back(); }, "35 bytes of positions"},
      {[](auto* b) { b->set_normals(b->normals().substr(12)); }, "24 of normals"},
      {[](auto* b) { b->set_copies(b->copies().substr(1)); }, "2 of copy numbers"},
      {[](auto* b) {
         b->set_triangles(Bytes<std::uint32_t>({0, 1}));
       },
       "8 of triangles"},
      {[](auto* b) {
         b->set_triangles(Bytes<std::uint32_t>({0, 1, 3}));
       },
       "a triangle of vertex 3 of 3"},
      {[](auto* b) {
         b->set_positions(Bytes<float>({0, 0, 0, 1, 0, 0, 0, -0.5F, 0}));
       },
       "a vertex at -0.5 on axis 1: must lie in [0, 4]"},
      {[](auto* b) {
         b->set_positions(Bytes<float>({0, 0, 0, 1, 0, 0, 0, 1, 4.5F}));
       },
       "a vertex at 4.5 on axis 2"},
      {[](auto* b) {
         b->set_positions(Bytes<float>({0, 0, 0, std::nanf(""), 0, 0, 0, 1, 0}));
       },
       "a vertex at nan on axis 0"},
  };
  for (const Case& c : cases) {
    internal::BlockSurface block = MakeBlock();
    c.change(&block);
    mesh::BlockMesh mesh;
    EXPECT_THAT(UnpackBlock(block, Layout(), &mesh),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(c.error)));
  }
}

// A block without copy numbers has one vertex a place.
TEST(SurfaceStreamTest, CopyNumbersMayBeLeftOut) {
  internal::BlockSurface block = MakeBlock();
  block.clear_copies();
  mesh::BlockMesh mesh;
  ISOSCOPE_ASSERT_OK(UnpackBlock(block, Layout(), &mesh));
  EXPECT_TRUE(mesh.copies.empty());
}

TEST(SurfaceStreamTest, SumsAreUnpackedAsTheyWereSent) {
  math::ExactSum area;
  area.Add(2.5);
  math::ExactSum volume;
  volume.Add(-0.1);
  internal::SurfaceSums proto;
  proto.set_area(area.Encode());
  proto.set_volume(volume.Encode());
  proto.set_triangle_count(7);
  proto.set_open_edge_count(3);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const solid::SurfaceSums sums, UnpackSums(proto));
  EXPECT_EQ(sums.area.Value(), 2.5);
  EXPECT_EQ(sums.volume.Value(), -0.1);
  EXPECT_EQ(sums.triangle_count, 7);
  EXPECT_EQ(sums.open_side_count, 3);
  const std::vector<std::function<void(internal::SurfaceSums*)>> spoil = {
      [](auto* p) { p->clear_area(); }, [](auto* p) { p->mutable_volume()->pop_back(); },
      [](auto* p) { p->set_triangle_count(-1); }, [](auto* p) { p->set_open_edge_count(-1); }};
  for (const auto& change : spoil) {
    internal::SurfaceSums hostile = proto;
    change(&hostile);
    EXPECT_THAT(UnpackSums(hostile), StatusIs(absl::StatusCode::kInvalidArgument));
  }
}

}  // namespace
}  // namespace isoscope::server
