#include "core/frame/picture_revision.h"

#include "gtest/gtest.h"

namespace isoscope::frame {
namespace {

TEST(PictureRevisionTest, NumberBackEndAndDriverTellRevisionsApart) {
  const PictureRevision cpu{.number = 3, .back_end = BackEnd::kCpu, .driver = ""};
  const PictureRevision egl{.number = 3, .back_end = BackEnd::kEgl, .driver = "llvmpipe"};
  PictureRevision other_driver = egl;
  other_driver.driver = "V3D";
  PictureRevision newer = cpu;
  ++newer.number;
  EXPECT_EQ(cpu, cpu);
  EXPECT_FALSE(cpu == egl);
  EXPECT_FALSE(egl == other_driver);
  EXPECT_FALSE(cpu == newer);
  EXPECT_EQ(ToString(cpu), "3 cpu");
  EXPECT_EQ(ToString(egl), "3 egl (llvmpipe)");
}

TEST(PictureRevisionTest, OnlyTheCpuBackEndComparesColors) {
  EXPECT_EQ(TieRuleOf(BackEnd::kCpu), image::TieRule::kColor);
  EXPECT_EQ(TieRuleOf(BackEnd::kEgl), image::TieRule::kOwner);
}

}  // namespace
}  // namespace isoscope::frame
