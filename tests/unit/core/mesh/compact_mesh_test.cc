#include "core/mesh/compact_mesh.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <random>
#include <vector>

#include "gtest/gtest.h"

namespace isoscope::mesh {
namespace {

// Vertices in a row, triangles over all of them, the last one too.
BlockMesh MakeMesh(std::size_t vertex_count, std::size_t triangle_count) {
  std::mt19937 random(5);
  std::uniform_real_distribution<float> component(-1, 1);
  BlockMesh mesh;
  mesh.block_id = 77;
  mesh.owned_vertex_count = 5;
  for (std::size_t i = 0; i < vertex_count; ++i) {
    mesh.positions.push_back({static_cast<float>(i) + 0.125F, -3.5F, 1e9F});
    mesh.normals.push_back({component(random), component(random), component(random)});
  }
  for (std::size_t i = 0; i < 3 * triangle_count; ++i) {
    mesh.indices.push_back(static_cast<std::uint32_t>(vertex_count - 1 - i % vertex_count));
  }
  return mesh;
}

void ExpectSame(const CompactMesh& compact, const BlockMesh& mesh) {
  EXPECT_EQ(compact.block_id, mesh.block_id);
  EXPECT_EQ(compact.owned_vertex_count, mesh.owned_vertex_count);
  EXPECT_EQ(compact.triangle_count(), mesh.triangle_count());
  EXPECT_TRUE(std::equal(compact.positions.begin(), compact.positions.end(), mesh.positions.begin(),
                         mesh.positions.end()));
  ASSERT_EQ(compact.normals.size(), mesh.normals.size());
  for (std::size_t i = 0; i < mesh.normals.size(); ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      ASSERT_EQ(compact.normals[i][axis], std::lround(mesh.normals[i][axis] * kNormalScale))
          << "normal " << i << ", axis " << axis;
    }
  }
  ASSERT_EQ(3 * compact.triangles.size(), mesh.indices.size());
  for (std::size_t triangle = 0; triangle < compact.triangles.size(); ++triangle) {
    for (std::size_t corner = 0; corner < 3; ++corner) {
      ASSERT_EQ(compact.triangles[triangle][corner], mesh.indices[3 * triangle + corner]);
    }
  }
}

template <typename T>
void ExpectValuesAreKept(std::size_t vertex_count) {
  const BlockMesh mesh = MakeMesh(vertex_count, 1900);
  BlockMeshView view = mesh;
  const std::size_t without = CompactSizeBytes(view);
  std::vector<T> values(vertex_count);
  for (std::size_t i = 0; i < vertex_count; ++i) {
    values[i] = static_cast<T>(i) / 3;
  }
  view.values = VertexValues(std::span<const T>(values));
  EXPECT_GE(CompactSizeBytes(view), without + sizeof(T) * vertex_count);
  const std::shared_ptr<const CompactMesh> compact = Compact(view);
  ExpectSame(*compact, mesh);
  ASSERT_EQ(compact->values.size(), vertex_count);
  for (std::size_t i = 0; i < vertex_count; ++i) {
    ASSERT_EQ(compact->values[i], static_cast<double>(values[i]));
  }
  EXPECT_EQ(compact->size_bytes(), Compact(mesh)->size_bytes() + sizeof(T) * vertex_count);
  EXPECT_TRUE(Compact(mesh)->values.empty());
}

TEST(CompactMeshTest, ValuesAreKeptAndTakeNoRoomWhereThereAreNone) {
  for (const std::size_t vertex_count : {std::size_t{1000}, std::size_t{70'000}}) {
    ExpectValuesAreKept<float>(vertex_count);
    ExpectValuesAreKept<double>(vertex_count);
  }
}

TEST(CompactMeshTest, SaysTheSameAsTheMeshItWasMadeOf) {
  const BlockMesh mesh = MakeMesh(1000, 1900);
  const std::shared_ptr<const CompactMesh> compact = Compact(mesh);
  ExpectSame(*compact, mesh);
  EXPECT_EQ(compact->size_bytes(), 1000u * 18 + 1900u * 6);
}

TEST(CompactMeshTest, VertexNumbersOfSixteenBitsEndWhereTheyAreNoLongerEnough) {
  const BlockMesh small = MakeMesh(65536, 30'000);
  ExpectSame(*Compact(small), small);
  EXPECT_NE(Compact(small)->triangles.small(), nullptr);
  EXPECT_EQ(Compact(small)->triangles.large(), nullptr);
  const BlockMesh large = MakeMesh(65537, 30'000);
  ExpectSame(*Compact(large), large);
  EXPECT_EQ(Compact(large)->triangles.small(), nullptr);
  EXPECT_NE(Compact(large)->triangles.large(), nullptr);
}

TEST(CompactMeshTest, NormalsKeepTheirSignsTheirEndsAndZero) {
  BlockMesh mesh;
  mesh.positions.assign(3, {});
  mesh.normals = {{1, -1, 0}, {-0.0F, 0.5F / kNormalScale, -0.5F / kNormalScale}, {0, 0, 0}};
  const std::shared_ptr<const CompactMesh> compact = Compact(mesh);
  EXPECT_EQ(compact->normals[0], (CompactNormal{32767, -32767, 0}));
  EXPECT_EQ(compact->normals[1], (CompactNormal{0, 1, -1}));
  EXPECT_EQ(compact->normals[2], CompactNormal());
}

TEST(CompactMeshTest, AnEmptyMeshIsEmpty) {
  const std::shared_ptr<const CompactMesh> compact = Compact(BlockMesh());
  EXPECT_TRUE(compact->triangles.empty());
  EXPECT_EQ(compact->triangle_count(), 0);
  EXPECT_EQ(compact->size_bytes(), 0u);
}

TEST(CompactMeshTest, WritesNoFurtherThanItSays) {
  for (const std::size_t vertex_count : {0u, 1u, 21u, 22u, 70'000u}) {
    const BlockMesh mesh = MakeMesh(vertex_count, vertex_count);
    const std::size_t size = CompactSizeBytes(mesh);
    EXPECT_EQ(size % 64, 0u);
    std::vector<char> memory(size + 64, 'x');
    const CompactMesh* const compact = CompactInto(mesh, memory.data());
    EXPECT_EQ(reinterpret_cast<const char*>(compact), memory.data());
    ExpectSame(*compact, mesh);
    EXPECT_TRUE(std::all_of(memory.end() - 64, memory.end(), [](char c) { return c == 'x'; }));
  }
}

}  // namespace
}  // namespace isoscope::mesh
