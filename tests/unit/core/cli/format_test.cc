#include "core/cli/format.h"

#include <cstdint>
#include <limits>

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

}  // namespace
}  // namespace isoscope::cli
