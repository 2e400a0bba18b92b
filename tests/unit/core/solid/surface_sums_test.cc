#include "core/solid/surface_sums.h"

#include "gtest/gtest.h"

namespace isoscope::solid {
namespace {

// A tetrahedron of the three axes: its volume is 1/6 of the box, about any point.
TEST(SurfaceSumsTest, TrianglesOfATetrahedronSumToItsVolumeAndArea) {
  for (const math::Vec3d& from : {math::Vec3d{0, 0, 0}, {-3, 5, 7}}) {
    const math::Vec3d o = from;
    const math::Vec3d x = from + math::Vec3d{1, 0, 0};
    const math::Vec3d y = from + math::Vec3d{0, 2, 0};
    const math::Vec3d z = from + math::Vec3d{0, 0, 3};
    SurfaceSums first;
    first.AddTriangle({o, y, x});
    first.AddTriangle({o, x, z});
    first.open_side_count = 2;
    SurfaceSums second;
    second.AddTriangle({o, z, y});
    second.AddTriangle({x, y, z});
    second.open_side_count = 3;
    first.Add(second);
    EXPECT_NEAR(first.volume.Value(), 1, 1e-13);
    EXPECT_NEAR(first.area.Value(), 1 + 1.5 + 3 + 3.5, 1e-13);
    EXPECT_EQ(first.triangle_count, 4);
    EXPECT_EQ(first.open_side_count, 5);
  }
}

TEST(SurfaceSumsTest, PartsAddUpAndThereIsNoTotalIfAPartHasNone) {
  const auto sums_of = [](double side) {
    SurfaceSums sums;
    sums.AddTriangle({math::Vec3d{0, 0, 1}, {side, 0, 1}, {0, side, 1}});
    sums.open_side_count = 3;
    return sums;
  };
  const std::optional<SurfaceSums> both = TotalOf({sums_of(2), sums_of(4)});
  ASSERT_TRUE(both.has_value());
  EXPECT_EQ(both->area.Value(), 2 + 8);
  EXPECT_EQ(both->triangle_count, 2);
  EXPECT_EQ(both->open_side_count, 6);
  EXPECT_FALSE(TotalOf({sums_of(2), std::nullopt}).has_value());
}

}  // namespace
}  // namespace isoscope::solid
