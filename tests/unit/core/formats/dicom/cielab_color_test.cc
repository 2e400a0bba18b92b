#include "core/formats/dicom/cielab_color.h"

#include "gtest/gtest.h"

namespace isoscope::source {
namespace {

using volume::LabelColor;

TEST(CieLabColorTest, ColoursAreThoseThatDcmtkWrites) {
  EXPECT_EQ(ColorOfCieLab({0, 0, 0}), (LabelColor{0, 0, 0}));
  EXPECT_EQ(ColorOfCieLab({100, 0, 0}), (LabelColor{255, 255, 255}));
  EXPECT_EQ(ColorOfCieLab({53.585, 0, 0}), (LabelColor{128, 128, 128}));
  // Of dcmqi's example: 41661, 41167 and 40792 of 65535 for 221, 130, 101.
  EXPECT_EQ(ColorOfCieLab({63.5706, 32.1837, 30.7245}), (LabelColor{221, 130, 101}));
  // Red, green and blue.
  EXPECT_EQ(ColorOfCieLab({53.241, 80.092, 67.203}), (LabelColor{255, 0, 0}));
  EXPECT_EQ(ColorOfCieLab({87.735, -86.183, 83.179}), (LabelColor{0, 255, 0}));
  EXPECT_EQ(ColorOfCieLab({32.297, 79.188, -107.860}), (LabelColor{0, 0, 255}));
}

TEST(CieLabColorTest, ColoursOutsideOfSrgbAreClamped) {
  EXPECT_EQ(ColorOfCieLab({100, 127, 127}).red, 255);
  EXPECT_EQ(ColorOfCieLab({100, 127, 127}).blue, 0);
  EXPECT_EQ(ColorOfCieLab({50, -128, 0}).red, 0);
}

}  // namespace
}  // namespace isoscope::source
