#include "core/base/cancellation.h"

#include "absl/time/clock.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::base {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::_;

TEST(CancellationTest, DefaultNeverExpires) {
  Cancellation cancellation;
  ISOSCOPE_EXPECT_OK(cancellation.Check());
  EXPECT_EQ(cancellation.deadline(), absl::InfiniteFuture());
}

TEST(CancellationTest, PassedDeadlineIsDeadlineExceededAndACallOfCancelWins) {
  Cancellation cancellation(absl::Now() - absl::Seconds(1));
  EXPECT_THAT(cancellation.Check(), StatusIs(absl::StatusCode::kDeadlineExceeded, _));
  EXPECT_FALSE(cancellation.is_cancelled());
  cancellation.Cancel();
  EXPECT_THAT(cancellation.Check(), StatusIs(absl::StatusCode::kCancelled, _));
}

TEST(CancellationTest, CancelBeforeTheDeadlineIsCancelled) {
  Cancellation cancellation(absl::Now() + absl::Hours(1));
  ISOSCOPE_EXPECT_OK(cancellation.Check());
  cancellation.Cancel();
  EXPECT_TRUE(cancellation.is_cancelled());
  EXPECT_THAT(cancellation.Check(), StatusIs(absl::StatusCode::kCancelled, _));
}

}  // namespace
}  // namespace isoscope::base
