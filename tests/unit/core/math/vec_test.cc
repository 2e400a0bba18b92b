#include "core/math/vec.h"

#include <limits>

#include "gtest/gtest.h"

namespace isoscope::math {
namespace {

TEST(VecTest, CrossIsRightHandedAndPerpendicular) {
  EXPECT_EQ(Cross(Vec3d{1, 0, 0}, Vec3d{0, 1, 0}), (Vec3d{0, 0, 1}));
  const Vec3d a{1, 2, 3};
  const Vec3d b{-4, 5, 0.5};
  EXPECT_DOUBLE_EQ(Dot(Cross(a, b), a), 0);
  EXPECT_DOUBLE_EQ(Dot(Cross(a, b), b), 0);
}

TEST(VecTest, AxesAreNumberedXYZ) {
  Vec3d v{1, 2, 3};
  EXPECT_EQ(v[0], 1);
  EXPECT_EQ(v[1], 2);
  EXPECT_EQ(v[2], 3);
  v[1] = 7;
  EXPECT_EQ(v, (Vec3d{1, 7, 3}));
}

TEST(VecTest, LengthNormalizedAndFinite) {
  EXPECT_DOUBLE_EQ(Length(Vec3d{2, 3, 6}), 7);
  EXPECT_DOUBLE_EQ(Length(Normalized(Vec3d{2, 3, 6})), 1);
  EXPECT_TRUE(IsFinite(Vec3d{1, 2, 3}));
  EXPECT_FALSE(IsFinite(Vec3d{1, std::numeric_limits<double>::quiet_NaN(), 3}));
  EXPECT_FALSE(IsFinite(Vec3d{1, 2, std::numeric_limits<double>::infinity()}));
  EXPECT_EQ(Volume({3000, 3000, 3000}), 27'000'000'000);
}

}  // namespace
}  // namespace isoscope::math
