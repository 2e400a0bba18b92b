#include "bench/csv.h"

#include "gtest/gtest.h"

namespace isoscope::bench {
namespace {

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
}  // namespace isoscope::bench
