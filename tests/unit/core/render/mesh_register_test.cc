#include "core/render/mesh_register.h"

#include <memory>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::render {
namespace {

// A mesh of one vertex and this many triangles.
ShadedMesh MeshOf(std::size_t triangle_count) {
  mesh::BlockMesh block;
  block.positions = {{0, 0, 0}};
  block.normals = {{0, 0, 1}};
  block.indices.assign(3 * triangle_count, 0);
  ShadedMesh shaded;
  shaded.mesh = mesh::Compact(block);
  shaded.triangles = shaded.mesh->triangles;
  return shaded;
}

TEST(MeshRegisterTest, IdsBeginAtWholeUnitsAndLeadToTheirMesh) {
  MeshRegister meshes;
  for (int round = 0; round < 2; ++round) {
    std::vector<ShadedMesh> added{MeshOf(1), MeshOf(0), MeshOf(64), MeshOf(65), MeshOf(2)};
    std::vector<const mesh::CompactMesh*> expected;
    std::size_t bytes = 0;
    for (const ShadedMesh& mesh : added) {
      expected.push_back(mesh.mesh.get());
      bytes += mesh.mesh->size_bytes();
    }
    std::vector<std::uint32_t> first;
    meshes.Keep(added, &first);
    EXPECT_THAT(first, ::testing::ElementsAre(0, 64, 64, 128, 256));
    EXPECT_EQ(meshes.primitive_count(), 320U);
    EXPECT_EQ(meshes.kept_bytes(), bytes);
    const auto list = std::make_unique<ShadeList>();
    for (const std::uint32_t id : {0U, 64U, 127U, 128U, 192U, 257U}) {
      list->Append(0, 0, 0, 0, id);
    }
    meshes.FindMeshes(list.get());
    const std::vector<std::size_t> mesh_of_fragment{0, 2, 2, 3, 3, 4};
    for (std::size_t i = 0; i < mesh_of_fragment.size(); ++i) {
      EXPECT_EQ(list->meshes[i]->mesh.get(), expected[mesh_of_fragment[i]]) << i;
      EXPECT_EQ(list->meshes[i]->first_primitive_id, first[mesh_of_fragment[i]]) << i;
    }
    meshes.Clear();
    EXPECT_EQ(meshes.primitive_count() + meshes.kept_bytes(), 0U);
  }
}

}  // namespace
}  // namespace isoscope::render
