#include "core/math/vec_conversion.h"

#include "gtest/gtest.h"

namespace isoscope::math {
namespace {

TEST(VecConversionTest, FloatsBecomeDoublesAndDoublesRound) {
  EXPECT_EQ(DoubleOf({1.5F, 0.1F, -3.0F}), (Vec3d{1.5, static_cast<double>(0.1F), -3}));
  EXPECT_EQ(FloatOf({1.5, 0.1, -3}), (Vec3f{1.5F, 0.1F, -3.0F}));
}

}  // namespace
}  // namespace isoscope::math
