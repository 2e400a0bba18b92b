#include "core/mesh/mesh_point.h"

#include <cmath>
#include <limits>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/random.h"

namespace isoscope::mesh {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// A right triangle, one above it, and two without an area.
BlockMesh MakeMesh() {
  BlockMesh mesh;
  mesh.positions = {{0, 0, 0}, {2, 0, 0}, {0, 2, 0}, {0, 0, 5}, {2, 0, 5}, {0, 2, 5}, {9, 0, 0}};
  mesh.indices = {0, 1, 2, 3, 4, 5, 1, 6, 6, 6, 6, 6};
  return mesh;
}

math::Vec3d PositionOf(const BlockMesh& mesh, const MeshPoint& point) {
  math::Vec3d sum;
  for (std::size_t i = 0; i < 3; ++i) {
    const math::Vec3f& p = mesh.positions[point.vertices[i]];
    sum = sum + math::Vec3d{double{p.x}, double{p.y}, double{p.z}} * point.weights[i];
  }
  return sum;
}

TEST(MeshPointTest, TheNearestPointIsInsideOnASideOrACorner) {
  const BlockMesh mesh = MakeMesh();
  const struct {
    math::Vec3d position;
    math::Vec3d nearest;
  } cases[] = {{{0.5, 0.5, 1}, {0.5, 0.5, 0}},  {{0.5, 0.5, 3}, {0.5, 0.5, 5}},
               {{1, -3, 0}, {1, 0, 0}},         {{-1, -1, 7}, {0, 0, 5}},
               {{2, 2, 0}, {1, 1, 0}},          {{5, 1, 0}, {5, 0, 0}},
               {{20, 0, 0}, {9, 0, 0}},         {{0, 0, 0}, {0, 0, 0}},
               {{0.5, 0.5, 2.5}, {0.5, 0.5, 0}}};  // as near to the second triangle
  for (const auto& c : cases) {
    const std::optional<MeshPoint> point = NearestPoint(mesh, c.position);
    ASSERT_TRUE(point.has_value());
    EXPECT_EQ(PositionOf(mesh, *point), c.nearest) << c.position.x << " " << c.position.y;
    EXPECT_DOUBLE_EQ(point->squared_distance,
                     math::Dot(c.position - c.nearest, c.position - c.nearest));
  }
  EXPECT_FALSE(NearestPoint(BlockMesh(), {0, 0, 0}).has_value());
}

TEST(MeshPointTest, NoPointOfAnyTriangleIsNearer) {
  BlockMesh mesh;
  for (std::uint64_t i = 0; i < 30; ++i) {
    mesh.positions.push_back({static_cast<float>(base::RandomUnit(1, i)),
                              static_cast<float>(base::RandomUnit(2, i)),
                              static_cast<float>(base::RandomUnit(3, i))});
    mesh.indices.push_back(static_cast<std::uint32_t>(i));
  }
  for (std::uint64_t i = 0; i < 200; ++i) {
    const math::Vec3d position{2 * base::RandomUnit(4, i) - 0.5, 2 * base::RandomUnit(5, i) - 0.5,
                               2 * base::RandomUnit(6, i) - 0.5};
    const MeshPoint nearest = NearestPoint(mesh, position).value();
    const math::Vec3d to_nearest = PositionOf(mesh, nearest) - position;
    EXPECT_NEAR(math::Dot(to_nearest, to_nearest), nearest.squared_distance, 1e-12);
    for (std::uint32_t first = 0; first < 30; first += 3) {
      for (int k = 0; k < 40; ++k) {
        const auto seed = 100 * i + static_cast<std::uint64_t>(k);
        double a = base::RandomUnit(7, seed);
        double b = base::RandomUnit(8, seed);
        if (a + b > 1) {
          a = 1 - a;
          b = 1 - b;
        }
        const MeshPoint other{{first, first + 1, first + 2}, {1 - a - b, a, b}};
        const math::Vec3d to_other = PositionOf(mesh, other) - position;
        EXPECT_GE(math::Dot(to_other, to_other), nearest.squared_distance - 1e-12);
      }
    }
  }
}

TEST(MeshPointTest, ValuesAreMixedByTheWeights) {
  const std::vector<double> wide = {1, 10, 100, kNaN};
  EXPECT_EQ(ValueAt(VertexValues(wide), {{0, 1, 2}, {0.5, 0.25, 0.25}}), 28);
  EXPECT_EQ(ValueAt(VertexValues(wide), {{3, 1, 2}, {0, 1, 0}}), 10) << "weight 0 does not count";
  EXPECT_TRUE(std::isnan(ValueAt(VertexValues(wide), {{3, 1, 2}, {0.5, 0.5, 0}})));
  const std::vector<float> narrow = {1, 10, 100};
  EXPECT_EQ(ValueAt(VertexValues(narrow), {{0, 1, 2}, {0.5, 0.25, 0.25}}), 28);
}

}  // namespace
}  // namespace isoscope::mesh
