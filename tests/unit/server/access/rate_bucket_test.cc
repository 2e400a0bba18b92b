#include "server/access/rate_bucket.h"

#include "gtest/gtest.h"

namespace isoscope::server {
namespace {

TEST(RateBucketTest, TheTimeToALevelCountsFromNow) {
  const base::MonotonicTime start;
  RateBucket bucket(/*rate=*/10, /*burst=*/20, start);
  EXPECT_EQ(bucket.TimeUntil(20, start), absl::ZeroDuration());
  bucket.Take(25);
  EXPECT_EQ(bucket.TimeUntil(1, start), absl::Milliseconds(600));
  EXPECT_EQ(bucket.TimeUntil(1, start + absl::Milliseconds(400)), absl::Milliseconds(200));
  EXPECT_EQ(bucket.TimeUntil(1, start + absl::Hours(1)), absl::ZeroDuration());
}

TEST(RateBucketDeathTest, ALevelThatNeverComesHasNoTime) {
  RateBucket bucket(/*rate=*/10, /*burst=*/20, base::MonotonicTime());
  EXPECT_DEATH(bucket.TimeUntil(21, base::MonotonicTime()), "wanted <= burst_");
}

}  // namespace
}  // namespace isoscope::server
