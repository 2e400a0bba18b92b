#include "core/base/check.h"

#include "gtest/gtest.h"

namespace isoscope::base {
namespace {

TEST(CheckDeathTest, FailurePrintsPlaceExpressionAndBothOperands) {
  const int blocks = 3;
  EXPECT_DEATH(ISOSCOPE_CHECK_EQ(blocks, 4), "check_test.cc:.*blocks == 4 \\(3 vs. 4\\)");
  EXPECT_DEATH(ISOSCOPE_CHECK_LT(blocks, 3), "blocks < 3 \\(3 vs. 3\\)");
  EXPECT_DEATH(ISOSCOPE_CHECK(blocks > 5), "check_test.cc:.*blocks > 5");
}

TEST(CheckTest, OperandsAreEvaluatedOnce) {
  int calls = 0;
  ISOSCOPE_CHECK_GE(++calls, 1);
  EXPECT_EQ(calls, 1);
}

}  // namespace
}  // namespace isoscope::base
