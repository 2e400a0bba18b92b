#include "clients/cpp/mesh_file/mesh_components.h"

#include <map>
#include <memory>
#include <random>
#include <set>
#include <vector>

#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/clients/cpp/mesh_file/test_meshes.h"

namespace isoscope::client {
namespace {

using ::isoscope::testing::TempDir;

TEST(MeshComponentsTest, SmallSpheresGoAndLargeOnesStayWhole) {
  const TempDir folder;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto mesh, MeshStore::Create(folder.path()));
  std::uint32_t vertex_count = 0;
  // 8, 512, 32, 128 triangles.
  for (const int level : {0, 3, 1, 2}) {
    const MeshPiece sphere = MakeSphere(level, {10.0 * level, 0, 0}, 2, vertex_count);
    vertex_count += static_cast<std::uint32_t>(sphere.vertex_count());
    ISOSCOPE_ASSERT_OK(mesh->Add(sphere));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DroppedComponents dropped,
                                DropSmallComponents(128, mesh.get()));
  EXPECT_EQ(dropped.component_count, 4);
  EXPECT_EQ(dropped.dropped_count, 2);
  EXPECT_EQ(dropped.dropped_triangle_count, 40);
  MemorySink sink;
  ISOSCOPE_ASSERT_OK(mesh->Emit(&sink));
  EXPECT_EQ(sink.mesh.triangle_count(), 512 + 128);
  EXPECT_EQ(sink.mesh.vertex_count(), 258 + 66) << "vertices of what was dropped are left";
  EXPECT_TRUE(IsClosed(sink.mesh.triangles));
  EXPECT_NEAR(VolumeOf(sink.mesh.positions, sink.mesh.triangles),
              VolumeOf(MakeSphere(3, {}, 2).positions, MakeSphere(3, {}, 2).triangles) +
                  VolumeOf(MakeSphere(2, {}, 2).positions, MakeSphere(2, {}, 2).triangles),
              1e-4);
}

TEST(MeshComponentsTest, RandomMeshesAreAsByBruteForce) {
  const TempDir folder;
  std::mt19937 random(5);
  for (int round = 0; round < 40; ++round) {
    const auto vertex_count = static_cast<std::uint32_t>(5 + random() % 60);
    MeshPiece piece;
    piece.positions.resize(std::size_t{3} * vertex_count);
    piece.normals.resize(std::size_t{3} * vertex_count);
    const std::size_t triangle_count = random() % 40;
    for (std::size_t i = 0; i < 3 * triangle_count; ++i) {
      piece.triangles.push_back(static_cast<std::uint32_t>(random() % vertex_count));
    }
    // Labels spread along triangles until nothing changes.
    std::vector<std::uint32_t> label(vertex_count);
    for (std::uint32_t i = 0; i < vertex_count; ++i) {
      label[i] = i;
    }
    for (bool has_changed = true; has_changed;) {
      has_changed = false;
      for (std::size_t i = 0; i < piece.triangles.size(); ++i) {
        std::uint32_t& a = label[piece.triangles[i]];
        std::uint32_t& b = label[piece.triangles[i - i % 3]];
        has_changed = has_changed || a != b;
        a = b = std::min(a, b);
      }
    }
    std::map<std::uint32_t, int> sizes;
    for (std::size_t i = 0; i < piece.triangles.size(); i += 3) {
      ++sizes[label[piece.triangles[i]]];
    }
    const int min = 1 + static_cast<int>(random() % 6);
    std::vector<std::uint32_t> expected;
    for (const std::uint32_t vertex : piece.triangles) {
      if (sizes[label[vertex]] >= min) {
        expected.push_back(vertex);
      }
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto mesh, MeshStore::Create(folder.path()));
    ISOSCOPE_ASSERT_OK(mesh->Add(piece));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DroppedComponents dropped,
                                  DropSmallComponents(min, mesh.get()));
    EXPECT_EQ(dropped.component_count, static_cast<std::int64_t>(sizes.size()));
    const auto kept = mesh->triangles().values();
    EXPECT_EQ(std::vector<std::uint32_t>(kept.begin(), kept.end()), expected) << round;
  }
}

TEST(MeshComponentsTest, EmptyMeshAndTooLargeAMinimumLeaveNothing) {
  const TempDir folder;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto mesh, MeshStore::Create(folder.path()));
  ISOSCOPE_EXPECT_OK(DropSmallComponents(1, mesh.get()).status());
  ISOSCOPE_ASSERT_OK(mesh->Add(MakeSphere(1, {}, 1)));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DroppedComponents dropped,
                                DropSmallComponents(INT64_MAX, mesh.get()));
  EXPECT_EQ(dropped.dropped_triangle_count, 32);
  MemorySink sink;
  ISOSCOPE_ASSERT_OK(mesh->Emit(&sink));
  EXPECT_EQ(sink.mesh.vertex_count(), 0);
}

}  // namespace
}  // namespace isoscope::client
