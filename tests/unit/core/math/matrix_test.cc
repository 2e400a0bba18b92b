#include "core/math/matrix.h"

#include "gtest/gtest.h"

namespace isoscope::math {
namespace {

TEST(MatrixTest, ProductAppliesTheRightFactorFirst) {
  const Mat4d shift = MakeAffine(Mat3d{}, {1, 2, 3});
  const Mat4d scale = MakeAffine({{Vec3d{2, 0, 0}, Vec3d{0, 3, 0}, Vec3d{0, 0, 4}}}, {0, 0, 0});
  EXPECT_EQ(TransformPoint(shift * scale, {1, 1, 1}), (Vec3d{3, 5, 7}));
  EXPECT_EQ(TransformPoint(scale * shift, {1, 1, 1}), (Vec3d{4, 9, 16}));
}

TEST(MatrixTest, VectorsAreNotTranslated) {
  EXPECT_EQ(TransformVector(MakeAffine(Mat3d{}, {5, 6, 7}), {1, 2, 3}), (Vec3d{1, 2, 3}));
}

TEST(MatrixTest, InverseUndoesAndDeterminantIsTheSignedVolume) {
  const Mat3d m{{Vec3d{2, 1, 0}, Vec3d{-1, 3, 0.5}, Vec3d{0, 0.25, 4}}};
  EXPECT_DOUBLE_EQ(Determinant(m), 2 * (3 * 4 - 0.5 * 0.25) - 1 * (-1 * 4 - 0));
  const Vec3d v{1, -2, 3};
  const Vec3d back = Inverted(m) * (m * v);
  EXPECT_NEAR(back.x, v.x, 1e-14);
  EXPECT_NEAR(back.y, v.y, 1e-14);
  EXPECT_NEAR(back.z, v.z, 1e-14);
  EXPECT_DOUBLE_EQ(Determinant({{Vec3d{0, 1, 0}, Vec3d{1, 0, 0}, Vec3d{0, 0, 1}}}), -1);
}

TEST(MatrixTest, ColumnsComeFirstInMemory) {
  const Mat4d m = MakeAffine({{Vec3d{1, 2, 3}, Vec3d{4, 5, 6}, Vec3d{7, 8, 9}}}, {10, 11, 12});
  EXPECT_EQ(m.m, (std::array<double, 16>{1, 2, 3, 0, 4, 5, 6, 0, 7, 8, 9, 0, 10, 11, 12, 1}));
}

}  // namespace
}  // namespace isoscope::math
