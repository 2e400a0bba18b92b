#include "client-cli/bench_statistics.h"

#include "client-cli/csv.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::cli {
namespace {

using ::testing::HasSubstr;

TEST(BenchStatisticsTest, MedianIsTheMiddleOrTheMeanOfTheTwoThere) {
  EXPECT_EQ(Median({}), 0);
  EXPECT_EQ(Median({7}), 7);
  EXPECT_EQ(Median({9, 1, 5}), 5);
  EXPECT_EQ(Median({9, 1, 5, 4}), 4.5);
  EXPECT_EQ(Median({1e9, 3, 3, 3, 1}), 3) << "one that is far out does not count";
}

TEST(BenchStatisticsTest, MaxOverMeanIsOneOnlyInPerfectBalance) {
  EXPECT_EQ(MaxOverMean({}), 0);
  EXPECT_EQ(MaxOverMean({0, 0}), 0);
  EXPECT_EQ(MaxOverMean({4, 4, 4}), 1);
  EXPECT_EQ(MaxOverMean({3, 1}), 1.5);
  EXPECT_EQ(MaxOverMean({0, 0, 0, 8}), 4);
  EXPECT_EQ(Sum({1, 2, 4}), 7);
}

TEST(BenchStatisticsTest, TheMachineHasCoresMemoryAndNames) {
  const Machine machine = DescribeMachine();
  EXPECT_GE(machine.core_count, 1);
  EXPECT_GT(machine.memory_gib, 0);
  EXPECT_NE(machine.processor, "");
  EXPECT_THAT(machine.system, HasSubstr("Linux"));
  EXPECT_EQ(ToString({.processor = "P", .core_count = 2, .memory_gib = 7.75, .system = "S"}),
            "P, 2 cores, 7.8 GiB, S");
  EXPECT_EQ(ToString({.processor = "P", .core_count = 1, .memory_gib = 1, .system = "S"}),
            "P, 1 core, 1.0 GiB, S");
}

TEST(CsvTest, CellsThatWouldBreakTheTableAreQuoted) {
  CsvTable table({"a", "b"});
  table.AddRow({"1", "x y"});
  table.AddRow({"2,3", "say \"hi\"\nthere"});
  EXPECT_EQ(table.ToString(), "a,b\n1,x y\n\"2,3\",\"say \"\"hi\"\"\nthere\"\n");
}

TEST(CsvTest, NumbersKeepNineDigits) {
  EXPECT_EQ(CsvNumber(60), "60");
  EXPECT_EQ(CsvNumber(0.125), "0.125");
  EXPECT_EQ(CsvNumber(1234567.89123), "1234567.89");
  EXPECT_EQ(CsvNumber(-1e-7), "-1e-07");
}

}  // namespace
}  // namespace isoscope::cli
