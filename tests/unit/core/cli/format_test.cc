#include "core/cli/format.h"

#include <cstdint>
#include <limits>
#include <string>

#include "gtest/gtest.h"

namespace isoscope::cli {
namespace {

TEST(FormatTest, CountsHaveSeparatorsEveryThreeDigits) {
  EXPECT_EQ(FormatCount(0), "0");
  EXPECT_EQ(FormatCount(999), "999");
  EXPECT_EQ(FormatCount(1000), "1,000");
  EXPECT_EQ(FormatCount(-100), "-100");
  EXPECT_EQ(FormatCount(-1234567), "-1,234,567");
  EXPECT_EQ(FormatCount(std::numeric_limits<std::int64_t>::min()), "-9,223,372,036,854,775,808");
}

TEST(FormatTest, SizesAndTimesHaveOneDecimal) {
  EXPECT_EQ(FormatMebibytes(0), "0.0 MiB");
  EXPECT_EQ(FormatMebibytes(1536 * 1024), "1.5 MiB");
  EXPECT_EQ(FormatMebibytes(std::int64_t{5} << 32), "20,480.0 MiB");
  EXPECT_EQ(FormatMilliseconds(12345.678), "12,345.7");
  EXPECT_EQ(FormatElapsed(absl::Milliseconds(400)), "0 s");
  EXPECT_EQ(FormatElapsed(absl::Seconds(59)), "59 s");
  EXPECT_EQ(FormatElapsed(absl::Seconds(185)), "3 min 05 s");
  EXPECT_EQ(FormatElapsed(absl::Minutes(127)), "2 h 07 min");
}

TEST(FormatTest, TheShortestTextReadsBackAsTheSameNumber) {
  for (const double value : {0.0, 0.1, 1.0 / 3, 1e-300, 123456789.123456789, 4600000.015625}) {
    EXPECT_EQ(std::stod(FormatShortest(value)), value);
  }
  EXPECT_EQ(FormatShortest(0.25), "0.25");
  EXPECT_EQ(FormatShortest(-1e300), "-1e+300");
  EXPECT_EQ(FormatShortest(100000), "1e+05");
}

TEST(FormatTest, LabelsAndIsovaluesHaveAllTheirDigits) {
  EXPECT_EQ(FormatValue(100000), "100000");
  EXPECT_EQ(FormatValue(-3), "-3");
  EXPECT_EQ(FormatValue(-0.0), "0");
  EXPECT_EQ(FormatValue(0x1p53), "9007199254740992");
  EXPECT_EQ(FormatValue(-0x1p53), "-9007199254740992");
  EXPECT_EQ(FormatValue(0x1p53 + 2), FormatShortest(0x1p53 + 2));
  EXPECT_EQ(FormatValue(16777216.5), "16777216.5");
  EXPECT_EQ(FormatValue(std::numeric_limits<double>::infinity()), "inf");
}

TEST(FormatTest, ACoordinateThatIsAFloatReadsBackAsThat) {
  EXPECT_EQ(FormatCoordinate(double{0.1F}), "0.1");
  EXPECT_EQ(FormatCoordinate(0.1), "0.1");
  EXPECT_EQ(FormatCoordinate(4600000.015625), "4600000.015625");
  EXPECT_EQ(FormatCoordinate(-12), "-12");
}

}  // namespace
}  // namespace isoscope::cli
