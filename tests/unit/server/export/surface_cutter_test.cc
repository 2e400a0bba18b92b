#include "server/export/surface_cutter.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <numbers>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "tests/support/block_cutter.h"
#include "tests/support/mesh_metrics.h"
#include "tests/support/synthetic_fields.h"

namespace isoscope::server {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr std::int64_t kSide = 33;

volume::GridGeometry Cube() {
  volume::GridGeometry geometry;
  geometry.sample_dims = {kSide, kSide, kSide};
  return geometry;
}

// One triangle in the first block, with edge keys 1, 2, 3.
mesh::BlockMesh Triangle(const std::array<math::Vec3f, 3>& corners) {
  mesh::BlockMesh block;
  block.positions.assign(corners.begin(), corners.end());
  block.normals.assign(3, {0, 0, 1});
  block.indices = {0, 1, 2};
  block.edge_keys = {1, 2, 3};
  return block;
}

// Cuts one block of one volume of a single block.
mesh::BlockMesh CutOne(mesh::BlockMesh block, const view::ClipRegion& region) {
  const volume::BlockLayout layout =
      volume::BlockLayout::Make({kSide, kSide, kSide}, {32, 32, 32}).value();
  SurfaceCutter(view::Clipper(region, Cube()), layout).Cut(&block);
  return block;
}

view::ClipRegion RightOf(double x) { return {.half_spaces = {{{1, 0, 0}, x}}, .box = {}}; }

TEST(SurfaceCutterTest, ATriangleWithOneCornerInsideKeepsASmallOne) {
  const mesh::BlockMesh cut =
      CutOne(Triangle({math::Vec3f{8, 0, 4}, {0, 0, 4}, {0, 8, 4}}), RightOf(6));
  EXPECT_THAT(cut.positions,
              ElementsAre(math::Vec3f{8, 0, 4}, math::Vec3f{6, 0, 4}, math::Vec3f{6, 2, 4}));
  EXPECT_THAT(cut.normals,
              ElementsAre(math::Vec3f{0, 0, 1}, math::Vec3f{0, 0, 1}, math::Vec3f{0, 0, 1}));
  EXPECT_THAT(cut.indices, ElementsAre(0, 1, 2));
  EXPECT_THAT(cut.edge_keys, ElementsAre(1, -1, -2));
}

TEST(SurfaceCutterTest, NormalsBetweenThoseOfTwoCornersHaveLengthOne) {
  mesh::BlockMesh block = Triangle({math::Vec3f{8, 0, 4}, {0, 0, 4}, {0, 8, 4}});
  block.normals = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  const mesh::BlockMesh cut = CutOne(block, RightOf(6));
  ASSERT_EQ(cut.normals.size(), 3U);
  for (const math::Vec3f& normal : cut.normals) {
    EXPECT_NEAR(std::hypot(normal.x, normal.y, normal.z), 1, 1e-6);
  }
  EXPECT_NEAR(cut.normals[1].x, 0.75 / std::hypot(0.75, 0.25), 1e-6);
}

TEST(SurfaceCutterTest, ATriangleWithTwoCornersInsideBecomesTwo) {
  const mesh::BlockMesh cut =
      CutOne(Triangle({math::Vec3f{0, 0, 4}, {8, 0, 4}, {8, 8, 4}}), RightOf(4));
  EXPECT_THAT(cut.positions, ElementsAre(math::Vec3f{8, 0, 4}, math::Vec3f{8, 8, 4},
                                         math::Vec3f{4, 0, 4}, math::Vec3f{4, 4, 4}));
  EXPECT_THAT(cut.indices, ElementsAre(2, 0, 1, 2, 1, 3)) << "turned as before";
}

TEST(SurfaceCutterTest, CornersOnTheBorderStayAsTheyAre) {
  const std::array<math::Vec3f, 3> corners{math::Vec3f{4, 0, 4}, {8, 0, 4}, {4, 8, 4}};
  EXPECT_THAT(CutOne(Triangle(corners), RightOf(4)).indices, ElementsAre(0, 1, 2));
  EXPECT_THAT(CutOne(Triangle(corners), RightOf(8)).indices, IsEmpty()) << "one point is left";
  const mesh::BlockMesh through_a_corner =
      CutOne(Triangle({math::Vec3f{4, 0, 4}, {8, 0, 4}, {0, 8, 4}}), RightOf(4));
  EXPECT_THAT(through_a_corner.edge_keys, ElementsAre(1, 2, -1));
  const mesh::BlockMesh in_the_border =
      CutOne(Triangle({math::Vec3f{4, 0, 0}, {4, 8, 0}, {4, 0, 8}}), RightOf(4));
  EXPECT_THAT(in_the_border.indices, ElementsAre(0, 1, 2)) << "a frame shows it, too";
}

TEST(SurfaceCutterTest, VerticesThatNoTriangleNeedsAreDropped) {
  mesh::BlockMesh block = Triangle({math::Vec3f{1, 0, 0}, {2, 0, 0}, {1, 1, 0}});
  const mesh::BlockMesh right = Triangle({math::Vec3f{9, 0, 0}, {10, 0, 0}, {9, 1, 0}});
  block.positions.insert(block.positions.end(), right.positions.begin(), right.positions.end());
  block.normals.insert(block.normals.end(), 3, {0, 0, 1});
  block.edge_keys.insert(block.edge_keys.end(), {4, 5, 6});
  block.indices.insert(block.indices.end(), {3, 4, 5});
  const mesh::BlockMesh cut = CutOne(block, RightOf(5));
  EXPECT_EQ(cut.positions, right.positions);
  EXPECT_THAT(cut.edge_keys, ElementsAre(4, 5, 6));
  EXPECT_THAT(cut.indices, ElementsAre(0, 1, 2));
}

TEST(SurfaceCutterTest, OppositeNormalsGiveNone) {
  mesh::BlockMesh block = Triangle({math::Vec3f{0, 0, 4}, {8, 0, 4}, {8, 8, 4}});
  block.normals = {{0, 0, 1}, {0, 0, -1}, {0, 0, -1}};
  const mesh::BlockMesh cut = CutOne(block, RightOf(4));
  EXPECT_EQ(cut.normals[2], (math::Vec3f{0, 0, 0}));
}

// A surface in blocks, cut and welded.
testing::WeldedMesh CutAndWeld(const testing::Field& field, const view::ClipRegion& region,
                               std::int64_t block_cells) {
  const volume::GridGeometry geometry = Cube();
  const volume::BlockLayout layout =
      volume::BlockLayout::Make(geometry.sample_dims, {block_cells, block_cells, block_cells})
          .value();
  const view::Clipper clipper(region, geometry);
  SurfaceCutter cutter(clipper, layout);
  std::vector<mesh::BlockMesh> blocks;
  for (mesh::BlockMesh& block : testing::ExtractAllBlocks(
           geometry, layout, volume::ScalarType::kFloat32,
           testing::SampleField(field, geometry.sample_dims, volume::ScalarType::kFloat32, 1, 0),
           0)) {
    if (clipper.SideOf(layout, block.block_id) != view::Clipper::Side::kOutside) {
      cutter.Cut(&block);
      blocks.push_back(std::move(block));
    }
  }
  return testing::Weld(layout, blocks);
}

// The edges with one triangle, from which all others are at a distance: their ends.
std::vector<math::Vec3f> BoundaryPoints(const testing::WeldedMesh& mesh) {
  std::map<std::pair<std::int64_t, std::int64_t>, int> edges;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const std::int64_t a = mesh.triangles[i];
    const std::int64_t b = mesh.triangles[i % 3 == 2 ? i - 2 : i + 1];
    ++edges[std::minmax(a, b)];
  }
  std::vector<math::Vec3f> points;
  for (const auto& [edge, count] : edges) {
    if (count == 1) {
      points.push_back(mesh.positions[static_cast<std::size_t>(edge.first)]);
      points.push_back(mesh.positions[static_cast<std::size_t>(edge.second)]);
    }
  }
  return points;
}

// The plane x = 16.3 in index space: a square of 32 x 32.
double Slab(const math::Vec3d& p) { return 0.3 / 16 - p.x; }

TEST(SurfaceCutterTest, APlaneCutByPlanesHasTheAreaOfThePolygon) {
  const auto area = [](const view::ClipRegion& region) {
    return testing::Measure(CutAndWeld(Slab, region, 8), Cube()).area;
  };
  EXPECT_NEAR(area({}), 32 * 32, 1e-3);
  EXPECT_NEAR(area({.half_spaces = {{{0, 1, 0}, 10.25}}, .box = {}}), 21.75 * 32, 1e-3);
  EXPECT_NEAR(area({.half_spaces = {{{0, 1, 1}, 32}}, .box = {}}), 32 * 32 / 2.0, 1e-3);
  EXPECT_NEAR(area({.half_spaces = {}, .box = math::Box3d{{0, 3.5, 7}, {32, 20.25, 9.125}}}),
              16.75 * 2.125, 1e-3);
  EXPECT_EQ(area({.half_spaces = {{{1, 0, 0}, 17}}, .box = {}}), 0);
}

TEST(SurfaceCutterTest, HalfASphereHasHalfTheAreaAndOneOpenCircle) {
  const testing::Field sphere = testing::SphereField(0.8);
  const double radius = 0.8 * 16;
  // Not on a plane of samples, and oblique.
  const math::Vec3d normal = math::Normalized(math::Vec3d{0.3, -0.5, 0.8});
  const double offset = math::Dot(normal, math::Vec3d{16, 16, 16});
  const view::ClipRegion region{.half_spaces = {{normal, offset}}, .box = {}};
  const testing::MeshMetrics whole = testing::Measure(CutAndWeld(sphere, {}, 8), Cube());
  const testing::WeldedMesh half = CutAndWeld(sphere, region, 8);
  const testing::MeshMetrics metrics = testing::Measure(half, Cube());
  const double expected = 2 * std::numbers::pi * radius * radius;
  EXPECT_NEAR(metrics.area, expected, 0.005 * expected);
  EXPECT_NEAR(metrics.area, whole.area / 2, 0.002 * expected);
  EXPECT_EQ(metrics.euler_characteristic(), 1) << "a disk";
  EXPECT_EQ(metrics.non_manifold_edge_count, 0);
  EXPECT_EQ(metrics.inconsistent_edge_count, 0);
  const std::vector<math::Vec3f> boundary = BoundaryPoints(half);
  EXPECT_EQ(boundary.size(), static_cast<std::size_t>(2 * metrics.boundary_edge_count));
  double length = 0;
  for (std::size_t i = 0; i < boundary.size(); i += 2) {
    const view::HalfSpace border{normal, offset};
    EXPECT_NEAR(view::Clipper::DistanceOf(border, boundary[i]), 0, 1e-5);
    EXPECT_NEAR(view::Clipper::DistanceOf(border, boundary[i + 1]), 0, 1e-5);
    const math::Vec3f step = boundary[i] - boundary[i + 1];
    length += static_cast<double>(math::Length(step));
  }
  EXPECT_NEAR(length, 2 * std::numbers::pi * radius, 0.01 * length) << "one circle";
}

// Any field, any region: outside there is nothing, open edges lie on borders alone, and the size of
// blocks does not show.
TEST(SurfaceCutterTest, RandomRegionsLeaveNoCrackBetweenBlocks) {
  std::uint64_t counter = 0;
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * base::RandomUnit(7, counter++);
  };
  int cut_count = 0;
  for (int i = 0; i < 24; ++i) {
    view::ClipRegion region;
    for (int plane = 0; plane < i % 4; ++plane) {
      const math::Vec3d normal{uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)};
      const math::Vec3d point{uniform(8, 24), uniform(8, 24), uniform(8, 24)};
      region.half_spaces.push_back({normal, math::Dot(normal, point)});
    }
    if (i % 2 == 0) {  // also borders that lie on samples, where blocks meet
      region.box = math::Box3d{{0, std::floor(uniform(0, 12)), 8}, {uniform(20, 32), 24, 32}};
    }
    const testing::Field field =
        i % 3 == 0 ? testing::SphereField(0.8) : testing::TorusField(0.6, 0.3);
    const testing::WeldedMesh mesh = CutAndWeld(field, region, 8);
    const testing::WeldedMesh whole = CutAndWeld(field, region, 32);
    const view::Clipper clipper(region, Cube());
    for (const math::Vec3f& position : mesh.positions) {
      for (const view::HalfSpace& border : clipper.half_spaces()) {
        EXPECT_GE(view::Clipper::DistanceOf(border, position), -1e-5) << i;
      }
    }
    for (const math::Vec3f& point : BoundaryPoints(mesh)) {
      double nearest = 1;
      for (const view::HalfSpace& border : clipper.half_spaces()) {
        nearest = std::min(nearest, std::abs(view::Clipper::DistanceOf(border, point)));
      }
      EXPECT_LE(nearest, 1e-5) << "a crack in region " << i;
    }
    const auto sorted = [](const testing::WeldedMesh& of) {
      std::multiset<std::array<float, 3>> points;
      for (const math::Vec3f& p : of.positions) {
        points.insert({p.x, p.y, p.z});
      }
      return points;
    };
    EXPECT_EQ(sorted(mesh), sorted(whole)) << i;
    EXPECT_EQ(mesh.triangles.size(), whole.triangles.size()) << i;
    cut_count += BoundaryPoints(mesh).empty() ? 0 : 1;
  }
  EXPECT_GT(cut_count, 10) << "the regions test nothing";
}

TEST(SurfaceCutterDeathTest, MeshWithoutEdgeKeysIsRefused) {
  mesh::BlockMesh block = Triangle({math::Vec3f{0, 0, 4}, {8, 0, 4}, {8, 8, 4}});
  block.edge_keys.clear();
  EXPECT_DEATH(CutOne(block, RightOf(4)), "edge_keys");
}

}  // namespace
}  // namespace isoscope::server
