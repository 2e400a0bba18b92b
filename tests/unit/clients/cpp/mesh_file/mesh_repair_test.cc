#include "clients/cpp/mesh_file/mesh_repair.h"

#include <algorithm>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "clients/cpp/mesh_file/mesh_measures.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/clients/cpp/mesh_file/test_meshes.h"

namespace isoscope::client {
namespace {

using ::isoscope::testing::TempDir;

struct Repaired {
  std::int64_t crowded_edge_count = 0;
  SurfaceMeasures before;
  SurfaceMeasures after;
  std::vector<std::uint32_t> triangles;
  std::int64_t vertex_count = 0;
};

Repaired Repair(const MeshPiece& mesh) {
  const TempDir folder;
  const std::unique_ptr<MeshStore> store = MeshStore::Create(folder.path()).value();
  ISOSCOPE_EXPECT_OK(store->Add(mesh));
  Repaired repaired;
  repaired.before = MeasureMesh(store.get()).value();
  repaired.crowded_edge_count = SeparateTouchingParts(store.get()).value();
  repaired.after = MeasureMesh(store.get()).value();
  MemorySink sink;
  ISOSCOPE_EXPECT_OK(store->Emit(&sink));
  repaired.triangles = sink.mesh.triangles;
  repaired.vertex_count = sink.mesh.vertex_count();
  return repaired;
}

// Tetrahedra of these vertices, turned outward, from points in general position.
MeshPiece Tetrahedra(const std::vector<std::array<std::uint32_t, 4>>& solids) {
  MeshPiece mesh;
  mesh.positions = {0,    0, 0,  0,    0, 1, 1, 0,     0.5F, 0,    1,  0.4F, -1,  0,
                    0.6F, 0, -1, 0.5F, 3, 3, 3, -0.5F, 1,    0.5F, -1, 0.5F, 0.5F};
  mesh.normals = std::vector<float>(mesh.positions.size(), 0);
  const auto at = [&](std::uint32_t vertex) {
    const float* const p = mesh.positions.data() + 3 * std::size_t{vertex};
    return math::Vec3d{double{p[0]}, double{p[1]}, double{p[2]}};
  };
  for (auto [a, b, c, d] : solids) {
    if (math::Dot(math::Cross(at(b) - at(a), at(c) - at(a)), at(d) - at(a)) > 0) {
      std::swap(b, c);
    }
    mesh.triangles.insert(mesh.triangles.end(), {a, b, c, a, c, d, a, d, b, b, d, c});
  }
  return mesh;
}

TEST(MeshRepairTest, AMeshWithoutCrowdedEdgesStays) {
  const MeshPiece sphere = MakeSphere(2, {0, 0, 0}, 1);
  const Repaired repaired = Repair(sphere);
  EXPECT_EQ(repaired.crowded_edge_count, 0);
  EXPECT_EQ(repaired.triangles, sphere.triangles);
}

// Two and three tetrahedra around the edge of vertices 0 and 1.
TEST(MeshRepairTest, SolidsThatShareAnEdgeGetVerticesOfTheirOwn) {
  for (const MeshPiece& mesh : {Tetrahedra({{0, 1, 2, 3}, {0, 1, 4, 5}}),
                                Tetrahedra({{0, 1, 2, 3}, {0, 1, 4, 5}, {0, 1, 3, 6}})}) {
    const Repaired repaired = Repair(mesh);
    EXPECT_GT(repaired.crowded_edge_count, 0);
    EXPECT_FALSE(IsClosed(mesh.triangles));
    EXPECT_TRUE(IsClosed(repaired.triangles));
    EXPECT_NEAR(repaired.after.area, repaired.before.area, 1e-12);
    EXPECT_NEAR(*repaired.after.volume, *repaired.before.volume, 1e-12);
  }
  EXPECT_EQ(Repair(Tetrahedra({{0, 1, 2, 3}, {0, 1, 4, 5}})).vertex_count, 8);
  // Four each, so none in the middle of the edge.
  EXPECT_EQ(Repair(Tetrahedra({{0, 1, 2, 3}, {0, 1, 4, 5}, {0, 1, 7, 8}})).vertex_count, 12);
}

// Tetrahedron 0 1 2 3, and triangles back to back on its edge 0 1 (and on their edge 0 9): volumes
// below are sums of tetrahedra around the edge, whose base is given by x and y alone.
TEST(MeshRepairTest, FinsNearAnEdgeAreOpenedWithoutANewVertex) {
  MeshPiece mesh = Tetrahedra({{0, 1, 2, 3}});
  mesh.positions.insert(mesh.positions.end(), {-0.125F, -0.125F, 0.5F, -0.125F, -0.125F, 0.25F});
  mesh.normals.resize(mesh.positions.size());
  mesh.triangles.insert(mesh.triangles.end(), {0, 1, 9, 1, 0, 9});
  const Repaired one = Repair(mesh);
  EXPECT_EQ(one.crowded_edge_count, 1);
  EXPECT_TRUE(IsClosed(one.triangles));
  EXPECT_EQ(one.triangles.size(), mesh.triangles.size());
  EXPECT_EQ(one.vertex_count, 5);
  EXPECT_NEAR(*one.before.volume, 1.0 / 6, 1e-12);
  EXPECT_NEAR(*one.after.volume, (1 + 0.125 + 0.125) / 6, 1e-12);

  mesh.triangles.insert(mesh.triangles.end(), {0, 9, 10, 9, 0, 10});
  const Repaired two = Repair(mesh);
  EXPECT_EQ(two.crowded_edge_count, 2);
  EXPECT_TRUE(IsClosed(two.triangles));
  EXPECT_EQ(two.triangles.size(), mesh.triangles.size());
  EXPECT_EQ(two.vertex_count, 6);
}

// A fin whose third vertex lies far away stays as it is, with vertices of its own.
TEST(MeshRepairTest, HighFinsStay) {
  MeshPiece mesh = Tetrahedra({{0, 1, 2, 3}});
  mesh.triangles.insert(mesh.triangles.end(), {0, 1, 6, 1, 0, 6});
  const Repaired repaired = Repair(mesh);
  EXPECT_TRUE(IsClosed(repaired.triangles));
  EXPECT_EQ(repaired.vertex_count, 4 + 3);
  EXPECT_NEAR(repaired.after.area, repaired.before.area, 1e-12);
  EXPECT_NEAR(*repaired.after.volume, *repaired.before.volume, 1e-12);
}

// Solids that share a vertex alone have no crowded edge, and keep it.
TEST(MeshRepairTest, SolidsThatShareAVertexStay) {
  const Repaired repaired = Repair(Tetrahedra({{0, 2, 3, 6}, {0, 1, 4, 5}}));
  EXPECT_EQ(repaired.crowded_edge_count, 0);
  EXPECT_EQ(repaired.vertex_count, 7);
}

// A hole beside a crowded edge stays the hole that it is.
TEST(MeshRepairTest, AnOpenMeshStaysAsOpen) {
  MeshPiece mesh = Tetrahedra({{0, 1, 2, 3}, {0, 1, 4, 5}});
  mesh.triangles.resize(mesh.triangles.size() - 3);
  const Repaired repaired = Repair(mesh);
  EXPECT_EQ(repaired.after.open_edge_count, 3);
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> sides;
  for (std::size_t i = 0; i < repaired.triangles.size(); ++i) {
    ++sides[{repaired.triangles[i], repaired.triangles[i % 3 == 2 ? i - 2 : i + 1]}];
  }
  EXPECT_TRUE(std::all_of(sides.begin(), sides.end(), [](const auto& s) { return s.second == 1; }));
}

}  // namespace
}  // namespace isoscope::client
