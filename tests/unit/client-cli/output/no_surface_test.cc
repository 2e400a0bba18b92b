#include "client-cli/output/no_surface.h"

#include <cmath>
#include <sstream>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::cli {
namespace {

using ::testing::HasSubstr;

isoscope::v1::Dataset DatasetInRange(double min, double max) {
  isoscope::v1::Dataset dataset;
  dataset.mutable_value_range()->set_min(min);
  dataset.mutable_value_range()->set_max(max);
  return dataset;
}

TEST(NoSurfaceTest, ALevelThatCellsCanCrossIsNoMatter) {
  for (const double isovalue : {-0.5, 0.0, 254.5, 255.0}) {
    EXPECT_EQ(DescribeNoSurface(DatasetInRange(-1, 255), isovalue), "") << isovalue;
  }
  const double next = std::nextafter(7.0, 8.0);
  EXPECT_EQ(DescribeNoSurface(DatasetInRange(7, next), next), "");
}

TEST(NoSurfaceTest, ALevelThatNoneCanCrossIsNamedWithTheRange) {
  for (const double isovalue : {-2.0, -1.0, 255.125, 1e30}) {
    EXPECT_THAT(DescribeNoSurface(DatasetInRange(-1, 255), isovalue), HasSubstr("[-1, 255]"))
        << isovalue;
  }
  EXPECT_THAT(DescribeNoSurface(DatasetInRange(-1, 255), 255.125), HasSubstr("isovalue 255.125 "));
  EXPECT_NE(DescribeNoSurface(DatasetInRange(3, 3), 3), "") << "a constant volume";
  EXPECT_THAT(DescribeNoSurface(isoscope::v1::Dataset(), 3), HasSubstr("NaN"));
}

TEST(NoSurfaceTest, TheLineGoesToStandardErrorAlone) {
  std::ostringstream out;
  std::ostringstream err;
  const Context context{.out = &out, .err = &err};
  WarnIfNoSurface(DatasetInRange(0, 9), {5}, context);
  EXPECT_EQ(err.str(), "");
  WarnIfNoSurface(DatasetInRange(0, 9), {10}, context);
  EXPECT_EQ(out.str(), "");
  EXPECT_EQ(err.str(),
            "isoscope: isovalue 10 has no surface: the values of the volume are in [0, 9], and it "
            "must be above the smallest and at most the largest\n");
}

}  // namespace
}  // namespace isoscope::cli
