#include "core/base/retry_delay.h"

#include "absl/strings/cord.h"
#include "gtest/gtest.h"

namespace isoscope::base {
namespace {

TEST(RetryDelayTest, IsGivenBackInWholeMillisecondsUpwards) {
  const absl::Status refused = absl::ResourceExhaustedError("full");
  EXPECT_EQ(RetryDelayOf(WithRetryDelay(refused, absl::Milliseconds(640))),
            absl::Milliseconds(640));
  EXPECT_EQ(RetryDelayOf(WithRetryDelay(refused, absl::Microseconds(1))), absl::Milliseconds(1));
  EXPECT_EQ(RetryDelayOf(WithRetryDelay(refused, absl::ZeroDuration())), absl::ZeroDuration());
}

TEST(RetryDelayTest, KeepsCodeAndMessage) {
  const absl::Status status = WithRetryDelay(absl::UnavailableError("gone"), absl::Seconds(2));
  EXPECT_TRUE(absl::IsUnavailable(status));
  EXPECT_EQ(status.message(), "gone");
}

TEST(RetryDelayTest, IsCutToItsRange) {
  const absl::Status refused = absl::ResourceExhaustedError("full");
  EXPECT_EQ(RetryDelayOf(WithRetryDelay(refused, -absl::Seconds(1))), absl::ZeroDuration());
  EXPECT_EQ(RetryDelayOf(WithRetryDelay(refused, absl::InfiniteDuration())), kMaxRetryDelay);
}

TEST(RetryDelayTest, OnlyRefusalsHaveOne) {
  EXPECT_EQ(RetryDelayOf(absl::OkStatus()), std::nullopt);
  EXPECT_EQ(RetryDelayOf(absl::ResourceExhaustedError("too large")), std::nullopt);
  EXPECT_EQ(RetryDelayOf(WithRetryDelay(absl::DataLossError("torn"), absl::Seconds(1))),
            std::nullopt);
}

TEST(RetryDelayTest, APayloadThatIsNoDurationIsNone) {
  absl::Status status = absl::ResourceExhaustedError("full");
  status.SetPayload("isoscope.retry_delay", absl::Cord("soon"));
  EXPECT_EQ(RetryDelayOf(status), std::nullopt);
}

}  // namespace
}  // namespace isoscope::base
