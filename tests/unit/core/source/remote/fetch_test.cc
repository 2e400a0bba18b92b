// Content-Range; open_address_test and remote_faults_test have the rest.

#include "core/source/remote/fetch.h"

#include "gtest/gtest.h"

namespace isoscope::source {
namespace {

TEST(FetchTest, ParsesContentRanges) {
  const auto range = ParseContentRange("bytes 5-9/100");
  ASSERT_TRUE(range.has_value());
  EXPECT_EQ(range->first, 5);
  EXPECT_EQ(range->last, 9);
  EXPECT_EQ(range->total, 100);
  EXPECT_EQ(ParseContentRange("Bytes 0-0/1")->last, 0);
  EXPECT_EQ(ParseContentRange("bytes 5-9/*")->total, -1);
  const auto end = ParseContentRange("bytes */100");
  ASSERT_TRUE(end.has_value());
  EXPECT_EQ(end->first, -1);
  EXPECT_EQ(end->total, 100);
  for (const char* const bad :
       {"", "bytes", "bytes 5-9", "bytes 9-5/100", "bytes 5-100/100", "bytes -5/100", "bytes 5-/9",
        "bytes */*", "bytes a-b/c", "items 5-9/100", "bytes 0x5-9/100", "bytes 5-9/+100",
        "bytes 5-9/99999999999999999999", "bytes 5 - 9/100"}) {
    EXPECT_FALSE(ParseContentRange(bad).has_value()) << bad;
  }
}

}  // namespace
}  // namespace isoscope::source
