#include "core/source/grid/affine_grid.h"

#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr math::Index3 kDims{4, 3, 2};
constexpr AffineRows kRows{{{0, -2, 0, 10}, {1.5, 0, 0, 20}, {0, 0, 3, 30}}};

TEST(AffineGridTest, CornersAreThoseOfTheTransform) {
  for (const PatientWorld world : {PatientWorld::kRas, PatientWorld::kLps}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto grid, GridFromAffine(kDims, kRows, world, "a"));
    const double turn = world == PatientWorld::kRas ? -1 : 1;
    EXPECT_EQ(grid.spacing, (math::Vec3d{1.5, 2, 3}));
    EXPECT_EQ(grid.origin, (math::Vec3d{turn * 10, turn * 20, 30}));
    const math::Vec3d last = math::TransformPoint(grid.world_from_index(), {3, 2, 1});
    EXPECT_EQ(last, (math::Vec3d{turn * 6, turn * 24.5, 33}));
  }
}

TEST(AffineGridTest, ShearIsNamed) {
  EXPECT_FALSE(FindShear(kRows).has_value());
  AffineRows rows = kRows;
  rows[0][0] = 1e-4;
  EXPECT_FALSE(FindShear(rows).has_value());
  rows[0][2] = 0.03;  // y and z, about half a degree
  rows[1][2] = -0.003;
  const auto shear = FindShear(rows);
  ASSERT_TRUE(shear.has_value());
  EXPECT_EQ(shear->first_axis, 1);
  EXPECT_EQ(shear->second_axis, 2);
  EXPECT_NEAR(shear->cosine, -0.01, 1e-6);
  EXPECT_THAT(ShearError(*shear, "a.nii"),
              StatusIs(kInvalid, AllOf(HasSubstr("a.nii: "), HasSubstr("axes y and z"),
                                       HasSubstr("90.57 degrees"), HasSubstr("--ignore-shear"))));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto grid,
                                GridFromAffine(kDims, rows, PatientWorld::kRas, "a.nii"));
  EXPECT_LT(math::Length(math::TransformPoint(grid.world_from_index(), {0, 0, 1}) -
                         math::Vec3d{-10.03, -19.997, 33}),
            1e-12);
}

TEST(AffineGridTest, WhatIsNoGridIsRefused) {
  AffineRows rows = kRows;
  rows[2][2] = 0;
  EXPECT_THAT(GridFromAffine(kDims, rows, PatientWorld::kRas, "a"),
              StatusIs(kInvalid, HasSubstr("spacing")));
  rows[2][2] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(GridFromAffine(kDims, rows, PatientWorld::kRas, "a"),
              StatusIs(kInvalid, HasSubstr("damaged")));
  EXPECT_THAT(GridFromAffine({4, 3, 1}, kRows, PatientWorld::kRas, "a"),
              StatusIs(kInvalid, HasSubstr("4 x 3 x 1")));
}

}  // namespace
}  // namespace isoscope::source
