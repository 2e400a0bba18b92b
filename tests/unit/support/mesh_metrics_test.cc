#include "tests/support/mesh_metrics.h"

#include <cmath>
#include <cstddef>
#include <utility>

#include "gtest/gtest.h"

namespace isoscope::testing {
namespace {

volume::GridGeometry MakeGeometry() {
  volume::GridGeometry geometry;
  geometry.sample_dims = {4, 4, 4};
  return geometry;
}

// The corner at the origin cut off the first octant, wound outwards.
WeldedMesh Tetrahedron() {
  return {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
          {{}, {}, {}, {}},
          {0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3}};
}

TEST(MeshMetricsTest, TetrahedronHasKnownFigures) {
  const MeshMetrics metrics = Measure(Tetrahedron(), MakeGeometry());
  EXPECT_EQ(metrics.vertex_count, 4);
  EXPECT_EQ(metrics.edge_count, 6);
  EXPECT_EQ(metrics.triangle_count, 4);
  EXPECT_EQ(metrics.euler_characteristic(), 2);
  EXPECT_EQ(metrics.boundary_edge_count, 0);
  EXPECT_EQ(metrics.non_manifold_edge_count, 0);
  EXPECT_EQ(metrics.inconsistent_edge_count, 0);
  EXPECT_EQ(metrics.degenerate_triangle_count, 0);
  EXPECT_DOUBLE_EQ(metrics.area, 1.5 + std::sqrt(3.0) / 2);
  EXPECT_DOUBLE_EQ(metrics.volume, 1.0 / 6);
}

TEST(MeshMetricsTest, SpacingScalesAreaAndVolumeAndMirroredFramesKeepTheSign) {
  volume::GridGeometry geometry = MakeGeometry();
  geometry.spacing = {2, 3, 4};
  EXPECT_DOUBLE_EQ(Measure(Tetrahedron(), geometry).volume, 4);
  geometry.direction.columns[0] = {-1, 0, 0};
  EXPECT_DOUBLE_EQ(Measure(Tetrahedron(), geometry).volume, 4);
  geometry.spacing = {2, 2, 2};
  EXPECT_DOUBLE_EQ(Measure(Tetrahedron(), geometry).area, 4 * (1.5 + std::sqrt(3.0) / 2));
}

TEST(MeshMetricsTest, InsideOutSurfaceHasNegativeVolume) {
  WeldedMesh mesh = Tetrahedron();
  for (std::size_t i = 0; i < mesh.triangles.size(); i += 3) {
    std::swap(mesh.triangles[i], mesh.triangles[i + 1]);
  }
  EXPECT_DOUBLE_EQ(Measure(mesh, MakeGeometry()).volume, -1.0 / 6);
}

TEST(MeshMetricsTest, MissingTriangleLeavesThreeBoundaryEdges) {
  WeldedMesh mesh = Tetrahedron();
  mesh.triangles.resize(9);
  EXPECT_EQ(Measure(mesh, MakeGeometry()).boundary_edge_count, 3);
}

TEST(MeshMetricsTest, OneFlippedTriangleGivesThreeInconsistentEdges) {
  WeldedMesh mesh = Tetrahedron();
  std::swap(mesh.triangles[0], mesh.triangles[1]);
  EXPECT_EQ(Measure(mesh, MakeGeometry()).inconsistent_edge_count, 3);
}

TEST(MeshMetricsTest, ThirdTriangleOnAnEdgeIsNonManifold) {
  WeldedMesh mesh = Tetrahedron();
  mesh.positions.push_back({1, 1, 1});
  mesh.normals.emplace_back();
  mesh.triangles.insert(mesh.triangles.end(), {0, 1, 4});
  EXPECT_EQ(Measure(mesh, MakeGeometry()).non_manifold_edge_count, 1);
}

TEST(MeshMetricsTest, ZeroAreaIsDegenerateAndUnusedVerticesDoNotCount) {
  const WeldedMesh mesh{{{0, 0, 0}, {0, 0, 0}, {1, 0, 0}, {9, 9, 9}}, {{}, {}, {}, {}}, {0, 1, 2}};
  const MeshMetrics metrics = Measure(mesh, MakeGeometry());
  EXPECT_EQ(metrics.degenerate_triangle_count, 1);
  EXPECT_EQ(metrics.vertex_count, 3);
}

TEST(MeshMetricsTest, EmptyMeshHasNothing) {
  const MeshMetrics metrics = Measure({}, MakeGeometry());
  EXPECT_EQ(metrics.vertex_count + metrics.edge_count + metrics.triangle_count, 0);
  EXPECT_EQ(metrics.area, 0);
}

}  // namespace
}  // namespace isoscope::testing
