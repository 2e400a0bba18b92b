#include "core/source/grid/sample_distance.h"

#include <cmath>
#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

TEST(SampleDistanceTest, OnlyFiniteNumbersAboveZeroAreDistances) {
  for (const double good : {1e-9, 0.5, 3.0, 1e9}) {
    EXPECT_TRUE(CheckSampleDistance("a", "pixdim[1]", good).ok()) << good;
  }
  for (const double bad : {0.0, -0.0, -1.0, std::nan(""), std::numeric_limits<double>::infinity(),
                           -std::numeric_limits<double>::infinity()}) {
    EXPECT_THAT(CheckSampleDistance("a.nii", "pixdim[1]", bad),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         AllOf(HasSubstr("a.nii: pixdim[1] is "), HasSubstr("--spacing X,Y,Z"))))
        << bad;
  }
  EXPECT_THAT(CheckSampleDistance("a", "b", -2.5).message(), HasSubstr("b is -2.5;"));
}

}  // namespace
}  // namespace isoscope::source
