#include "bench/sample_statistics.h"

#include "gtest/gtest.h"

namespace isoscope::bench {
namespace {

TEST(SampleStatisticsTest, MedianIsTheMiddleOrTheMeanOfTheTwoThere) {
  EXPECT_EQ(Median({}), 0);
  EXPECT_EQ(Median({7}), 7);
  EXPECT_EQ(Median({9, 1, 5}), 5);
  EXPECT_EQ(Median({9, 1, 5, 4}), 4.5);
  EXPECT_EQ(Median({1e9, 3, 3, 3, 1}), 3) << "one that is far out does not count";
}

TEST(SampleStatisticsTest, MaxOverMeanIsOneOnlyInPerfectBalance) {
  EXPECT_EQ(MaxOverMean({}), 0);
  EXPECT_EQ(MaxOverMean({0, 0}), 0);
  EXPECT_EQ(MaxOverMean({4, 4, 4}), 1);
  EXPECT_EQ(MaxOverMean({3, 1}), 1.5);
  EXPECT_EQ(MaxOverMean({0, 0, 0, 8}), 4);
  EXPECT_EQ(Sum({1, 2, 4}), 7);
}

}  // namespace
}  // namespace isoscope::bench
