#include "core/source/remote/retry_policy.h"

#include "gtest/gtest.h"

namespace isoscope::source {
namespace {

TEST(RetryPolicyTest, DelaysDoubleUpToABound) {
  const RetryRules rules{.first_delay = absl::Milliseconds(100), .max_delay = absl::Seconds(1)};
  EXPECT_EQ(RetryDelay(rules, 1, 0), absl::Milliseconds(50));
  EXPECT_EQ(RetryDelay(rules, 2, 0), absl::Milliseconds(100));
  EXPECT_EQ(RetryDelay(rules, 4, 0), absl::Milliseconds(400));
  EXPECT_EQ(RetryDelay(rules, 5, 0), absl::Milliseconds(500));
  EXPECT_EQ(RetryDelay(rules, 1000, 0), absl::Milliseconds(500));
  EXPECT_LE(RetryDelay(rules, 1000, 0.999), absl::Seconds(1));
  EXPECT_EQ(RetryDelay(rules, 1, 0.5), absl::Milliseconds(75));
}

TEST(RetryPolicyTest, ReadsRetryAfter) {
  EXPECT_EQ(ParseRetryAfter("120", ""), absl::Seconds(120));
  EXPECT_EQ(ParseRetryAfter(" 0 ", ""), absl::ZeroDuration());
  EXPECT_EQ(ParseRetryAfter("Sun, 06 Nov 1994 08:49:37 GMT", "Sun, 06 Nov 1994 08:49:30 GMT"),
            absl::Seconds(7));
  EXPECT_EQ(ParseRetryAfter("Sun, 06 Nov 1994 08:49:37 GMT", "Sun, 06 Nov 1994 09:00:00 GMT"),
            absl::ZeroDuration());
  for (const char* const bad :
       {"", "-1", "1.5", "soon", "99999999999999999999", "Sun, 06 Nov 1994 08:49:37"}) {
    EXPECT_EQ(ParseRetryAfter(bad, "Sun, 06 Nov 1994 08:49:30 GMT"), std::nullopt) << bad;
  }
  EXPECT_EQ(ParseRetryAfter("Sun, 06 Nov 1994 08:49:37 GMT", ""), std::nullopt);
}

TEST(RetryPolicyTest, KnowsWhatMayWorkLater) {
  for (const int status : {408, 429, 500, 502, 503, 504}) {
    EXPECT_TRUE(IsRetryableStatus(status)) << status;
  }
  for (const int status : {200, 206, 301, 400, 401, 403, 404, 412, 416, 501, 505}) {
    EXPECT_FALSE(IsRetryableStatus(status)) << status;
  }
}

}  // namespace
}  // namespace isoscope::source
