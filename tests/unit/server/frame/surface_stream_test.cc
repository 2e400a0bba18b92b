// Blocks as an agent may send them. Streams and replicas: isosurface_service_test, and
// tests/integration/replica_test.cc.

#include "server/frame/surface_stream.h"

#include <cstdint>
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
  block.set_edge_keys(Bytes<std::int64_t>({0, 7, 374}));
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
  EXPECT_EQ(mesh.edge_keys, (std::vector<std::int64_t>{0, 7, 374}));
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
      {[](auto* b) { b->set_edge_keys(b->edge_keys().substr(8)); }, "16 of edge keys"},
      {[](auto* b) {
         b->set_triangles(Bytes<std::uint32_t>({0, 1}));
       },
       "8 of triangles"},
      {[](auto* b) {
         b->set_triangles(Bytes<std::uint32_t>({0, 1, 3}));
       },
       "a triangle of vertex 3 of 3"},
      {[](auto* b) {
         b->set_edge_keys(Bytes<std::int64_t>({0, -1, 7}));
       },
       "edge key -1"},
      {[](auto* b) {
         b->set_edge_keys(Bytes<std::int64_t>({0, 375, 7}));
       },
       "edge key 375: must lie in [0, 375)"},
  };
  for (const Case& c : cases) {
    internal::BlockSurface block = MakeBlock();
    c.change(&block);
    mesh::BlockMesh mesh;
    EXPECT_THAT(UnpackBlock(block, Layout(), &mesh),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(c.error)));
  }
}

}  // namespace
}  // namespace isoscope::server
