#include "clients/cpp/mesh_file/mesh_measures.h"

#include <cmath>
#include <memory>
#include <numbers>

#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/clients/cpp/mesh_file/test_meshes.h"

namespace isoscope::client {
namespace {

using ::isoscope::testing::TempDir;

SurfaceMeasures MeasuresOf(const MeshPiece& mesh) {
  const TempDir folder;
  const std::unique_ptr<MeshStore> store = MeshStore::Create(folder.path()).value();
  ISOSCOPE_EXPECT_OK(store->Add(mesh));
  return MeasureMesh(store.get()).value();
}

TEST(MeshMeasuresTest, ASphereHasItsAreaAndVolumeWhereverItLies) {
  const SurfaceMeasures sphere = MeasuresOf(MakeSphere(5, {0, 0, 0}, 2));
  EXPECT_NEAR(sphere.area, 16 * std::numbers::pi, 0.05);
  ASSERT_TRUE(sphere.volume.has_value());
  EXPECT_NEAR(*sphere.volume, 32 * std::numbers::pi / 3, 0.05);
  EXPECT_EQ(sphere.triangle_count, 8192);
  EXPECT_EQ(sphere.open_edge_count, 0);
  MeshPiece far = MakeSphere(5, {0, 0, 0}, 2);
  far.origin = math::Vec3d{500000, 4600000, 0};
  EXPECT_NEAR(MeasuresOf(far).area, sphere.area, 1e-6);
  EXPECT_NEAR(*MeasuresOf(far).volume, *sphere.volume, 1e-6);
}

TEST(MeshMeasuresTest, ASurfaceThatIsTurnedOverHasANegativeVolume) {
  MeshPiece mesh = MakeSphere(2, {1, 2, 3}, 2);
  const SurfaceMeasures sphere = MeasuresOf(mesh);
  for (std::size_t i = 0; i < mesh.triangles.size(); i += 3) {
    std::swap(mesh.triangles[i], mesh.triangles[i + 1]);
  }
  const SurfaceMeasures turned = MeasuresOf(mesh);
  EXPECT_NEAR(*turned.volume, -*sphere.volume, 1e-12);
  EXPECT_NEAR(turned.area, sphere.area, 1e-12);
}

TEST(MeshMeasuresTest, ASurfaceWithAHoleHasNoVolume) {
  MeshPiece mesh = MakeSphere(2, {1, 2, 3}, 2);
  mesh.triangles.resize(mesh.triangles.size() - 3);
  const SurfaceMeasures open = MeasuresOf(mesh);
  EXPECT_FALSE(open.volume.has_value());
  EXPECT_EQ(open.open_edge_count, 3);
  EXPECT_EQ(open.triangle_count, 127);
  // A triangle that is turned over is open against each of its neighbours, twice.
  mesh = MakeSphere(2, {1, 2, 3}, 2);
  std::swap(mesh.triangles[0], mesh.triangles[1]);
  EXPECT_EQ(MeasuresOf(mesh).open_edge_count, 6);
}

// Sums are rounded once: the same digits in any order.
TEST(MeshMeasuresTest, TheOrderOfTrianglesDoesNotShow) {
  MeshPiece mesh = MakeSphere(4, {0.1, 0.2, 0.3}, 1.7);
  const SurfaceMeasures forth = MeasuresOf(mesh);
  std::vector<std::uint32_t> back;
  for (std::size_t i = mesh.triangles.size(); i > 0; i -= 3) {
    back.insert(back.end(), {mesh.triangles[i - 3], mesh.triangles[i - 2], mesh.triangles[i - 1]});
  }
  mesh.triangles = back;
  EXPECT_EQ(MeasuresOf(mesh), forth);
}

TEST(MeshMeasuresTest, NothingIsClosedAndHasNoVolumeAndNoArea) {
  EXPECT_EQ(MeasuresOf({}), (SurfaceMeasures{.area = 0, .volume = 0.0}));
}

}  // namespace
}  // namespace isoscope::client
