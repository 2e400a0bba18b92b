#include "clients/cpp/mesh_file/mesh_simplifier.h"

#include <cmath>
#include <memory>
#include <vector>

#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/clients/cpp/mesh_file/test_meshes.h"

namespace isoscope::client {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;

constexpr double kRadius = 50;

// Simplifies a sphere of 8 * 4^level triangles.
struct Simplified {
  SimplifyResult result;
  MeshPiece mesh;
};
Simplified SimplifySphere(int level, const SimplifyOptions& options) {
  const TempDir folder;
  Simplified simplified;
  absl::StatusOr<std::unique_ptr<MeshStore>> store = MeshStore::Create(folder.path());
  EXPECT_THAT(store, testing::IsOk());
  ISOSCOPE_EXPECT_OK((*store)->Add(MakeSphere(level, {7, 8, 9}, kRadius)));
  const absl::StatusOr<SimplifyResult> result = SimplifyMesh(options, store->get());
  EXPECT_THAT(result, testing::IsOk());
  simplified.result = result.value_or(SimplifyResult{});
  MemorySink sink;
  ISOSCOPE_EXPECT_OK((*store)->Emit(&sink));
  simplified.mesh = sink.mesh;
  EXPECT_EQ(simplified.mesh.triangle_count(), simplified.result.triangle_count);
  return simplified;
}

// The farthest that the middle of a triangle lies from the sphere; vertices stay on it.
double LargestDistance(const MeshPiece& mesh) {
  double largest = 0;
  for (std::size_t i = 0; i < mesh.triangles.size(); i += 3) {
    math::Vec3d middle;
    for (std::size_t k = 0; k < 3; ++k) {
      const float* const at = mesh.positions.data() + 3 * std::size_t{mesh.triangles[i + k]};
      const math::Vec3d corner{double{at[0]} - 7, double{at[1]} - 8, double{at[2]} - 9};
      EXPECT_NEAR(math::Length(corner), kRadius, 1e-4) << "a vertex was moved";
      middle = middle + corner * (1.0 / 3);
    }
    largest = std::max(largest, kRadius - math::Length(middle));
  }
  return largest;
}

TEST(MeshSimplifierTest, ShareIsReachedWithoutAHole) {
  const Simplified simplified = SimplifySphere(5, {.share = 0.1});  // 8192 triangles
  EXPECT_NEAR(static_cast<double>(simplified.result.triangle_count), 819, 5);
  EXPECT_TRUE(IsClosed(simplified.mesh.triangles));
  const double ideal = 4.0 / 3 * std::acos(-1.0) * kRadius * kRadius * kRadius;
  EXPECT_NEAR(VolumeOf(simplified.mesh.positions, simplified.mesh.triangles), ideal, 0.02 * ideal);
}

TEST(MeshSimplifierTest, PartsLeaveNoCracksAndComeNearTheShare) {
  for (const std::int64_t part : {500, 1000, 3000}) {
    SCOPED_TRACE(part);
    const Simplified simplified = SimplifySphere(5, {.share = 0.2, .part_triangle_count = part});
    EXPECT_TRUE(IsClosed(simplified.mesh.triangles));
    EXPECT_GE(simplified.result.triangle_count, 1638);
    EXPECT_LE(simplified.result.triangle_count, 1638 * 2);
  }
}

TEST(MeshSimplifierTest, ErrorBoundsHowFarTheSurfaceMoves) {
  std::int64_t last_count = 8192;
  for (const double bound : {0.05, 0.5, 2.0}) {
    SCOPED_TRACE(bound);
    for (const std::int64_t part : {std::int64_t{1} << 20, std::int64_t{1000}}) {
      const Simplified simplified =
          SimplifySphere(5, {.max_error = bound, .part_triangle_count = part});
      EXPECT_TRUE(IsClosed(simplified.mesh.triangles));
      EXPECT_LE(simplified.result.error, bound * 1.0001);
      // Estimated by quadrics, which is no bound of the distance: on a sphere it stays within
      // twice of it, beside the distance of the mesh before.
      EXPECT_LE(LargestDistance(simplified.mesh), 2 * bound + 0.05);
      if (part > 1000) {
        EXPECT_LT(simplified.result.triangle_count, last_count);
        last_count = simplified.result.triangle_count;
      }
    }
  }
  EXPECT_LT(last_count, 1000);
}

TEST(MeshSimplifierTest, WhicheverOfShareAndErrorIsFirstEndsIt) {
  const Simplified by_share = SimplifySphere(4, {.share = 0.5, .max_error = 100.0});
  EXPECT_NEAR(static_cast<double>(by_share.result.triangle_count), 1024, 5);
  const Simplified by_error = SimplifySphere(4, {.share = 0.01, .max_error = 1e-9});
  EXPECT_EQ(by_error.result.triangle_count, 2048);
}

TEST(MeshSimplifierTest, TheSameMeshGivesTheSameResult) {
  const SimplifyOptions options{.share = 0.3, .part_triangle_count = 700};
  const Simplified a = SimplifySphere(4, options);
  const Simplified b = SimplifySphere(4, options);
  EXPECT_EQ(a.mesh.positions, b.mesh.positions);
  EXPECT_EQ(a.mesh.normals, b.mesh.normals);
  EXPECT_EQ(a.mesh.triangles, b.mesh.triangles);
}

TEST(MeshSimplifierTest, EmptyMeshStaysAndProgressCanEndTheWork) {
  const TempDir folder;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto store, MeshStore::Create(folder.path()));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SimplifyResult empty,
                                SimplifyMesh({.share = 0.5}, store.get()));
  EXPECT_EQ(empty.triangle_count, 0);
  ISOSCOPE_ASSERT_OK(store->Add(MakeSphere(2, {}, 1)));
  SimplifyOptions options{.share = 0.5, .part_triangle_count = 50};
  int calls = 0;
  options.progress = [&](double done) {
    EXPECT_GE(done, 0);
    EXPECT_LE(done, 1);
    return ++calls == 2 ? absl::CancelledError("enough") : absl::OkStatus();
  };
  EXPECT_THAT(SimplifyMesh(options, store.get()).status(), StatusIs(absl::StatusCode::kCancelled));
}

}  // namespace
}  // namespace isoscope::client
