#include "core/solid/polygon_cutter.h"

#include <cmath>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::solid {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

TEST(PolygonCutterTest, SidesAreLinkedToPolygonsThatRunAgainstThem) {
  const std::vector<Points> polygons = LinkSides({{1, 2}, {7, 8}, {3, 1}, {2, 3}, {8, 9}, {9, 7}});
  ASSERT_EQ(polygons.size(), 2U);
  EXPECT_THAT(polygons[0], ElementsAre(2, 1, 3));
  EXPECT_THAT(polygons[1], ElementsAre(8, 7, 9));
  EXPECT_THAT(LinkSides({}), IsEmpty());
}

TEST(PolygonCutterTest, ShapeIsOneOverRootTwoOfHalfASquareAndNegativeFromBehind) {
  const math::Vec3d up{0, 0, 1};
  EXPECT_EQ(ShapeOf({math::Vec3d{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, up), 0.5);
  EXPECT_EQ(ShapeOf({math::Vec3d{0, 0, 0}, {0, 1, 0}, {1, 0, 0}}, up), -0.5);
  EXPECT_EQ(ShapeOf({math::Vec3d{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}, up), 0);
  EXPECT_EQ(ShapeOf({math::Vec3d{1, 1, 1}, {1, 1, 1}, {1, 1, 1}}, up), 0);
  EXPECT_NEAR(ShapeOf({math::Vec3d{0, 0, 0}, {2, 0, 0}, {1, std::sqrt(3.0), 0}}, up),
              std::sqrt(3.0) / 2, 1e-12);
}

TEST(PolygonCutterTest, TheWorstTriangleIsAsGoodAsItCanBe) {
  // Points 0, 1 and 2 on a line: a fan from 0 has a triangle without an area.
  const std::vector<math::Vec3d> points{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {2, 1, 0}, {0, 1, 0}};
  const auto quality = [&](std::size_t i, std::size_t k, std::size_t j) {
    return ShapeOf({points[i], points[k], points[j]}, {0, 0, 1});
  };
  const auto triangles = SplitByQuality(points.size(), quality);
  ASSERT_EQ(triangles.size(), 3U);
  double least = 1;
  double area = 0;
  for (const auto& [i, k, j] : triangles) {
    least = std::min(least, quality(i, k, j));
    area += math::Length(math::Cross(points[k] - points[i], points[j] - points[i])) / 2;
  }
  EXPECT_EQ(area, 2);
  EXPECT_GE(least, 0.4);
}

TEST(PolygonCutterTest, OfEqualSplitsTheFirstIsTaken) {
  const auto same = [](std::size_t, std::size_t, std::size_t) { return 1.0; };
  EXPECT_THAT(SplitByQuality(4, same),
              ElementsAre(ElementsAre(0U, 1U, 3U), ElementsAre(1U, 2U, 3U)));
  EXPECT_THAT(SplitByQuality(3, same), ElementsAre(ElementsAre(0U, 1U, 2U)));
  EXPECT_THAT(SplitByQuality(2, same), IsEmpty());
}

}  // namespace
}  // namespace isoscope::solid
