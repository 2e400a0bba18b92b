#include "clients/cpp/connection/retries.h"

#include <functional>
#include <thread>
#include <utility>
#include <vector>

#include "absl/time/clock.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "core/base/retry_delay.h"
#include "tests/support/status_matchers.h"

namespace isoscope::client {
namespace {

using isoscope::testing::IsOk;
using isoscope::testing::StatusIs;

absl::Status Refusal(absl::Duration delay) {
  return base::WithRetryDelay(absl::ResourceExhaustedError("36 wait"), delay);
}

// Answers with one status after the other.
class Answers {
 public:
  explicit Answers(std::vector<absl::Status> statuses) : statuses_(std::move(statuses)) {}
  absl::Status operator()() {
    times.push_back(base::MonotonicNow());
    return statuses_.at(times.size() - 1);
  }
  std::vector<base::MonotonicTime> times;

 private:
  const std::vector<absl::Status> statuses_;
};

TEST(RetriesTest, ARefusedCallIsMadeAgainWhenItWasToldToCome) {
  const base::Cancellation never;
  Answers answers(
      {Refusal(absl::Milliseconds(30)), Refusal(absl::ZeroDuration()), absl::OkStatus()});
  EXPECT_THAT(CallWithRetries(base::MonotonicTime::InfiniteFuture(), never, std::ref(answers)),
              IsOk());
  ASSERT_EQ(answers.times.size(), 3U);
  EXPECT_GE(answers.times[1] - answers.times[0], absl::Milliseconds(29));
}

TEST(RetriesTest, OtherErrorsAndRefusalsWithoutATimeAreFinal) {
  const base::Cancellation never;
  for (const absl::Status& status : {absl::ResourceExhaustedError("can never fit"),
                                     absl::UnavailableError("gone"), absl::DataLossError("torn")}) {
    Answers answers({status});
    EXPECT_EQ(CallWithRetries(base::MonotonicTime::InfiniteFuture(), never, std::ref(answers)),
              status);
  }
}

TEST(RetriesTest, ATimeThatIsNotBeforeTheDeadlineIsFinal) {
  const base::Cancellation never;
  Answers answers({Refusal(absl::Seconds(10))});
  EXPECT_THAT(CallWithRetries(base::MonotonicNow() + absl::Seconds(5), never, std::ref(answers)),
              StatusIs(absl::StatusCode::kResourceExhausted));
  Answers hour({Refusal(absl::Hours(1))});
  EXPECT_THAT(CallWithRetries(base::MonotonicTime::InfiniteFuture(), never, std::ref(hour)),
              StatusIs(absl::StatusCode::kResourceExhausted))
      << "nobody waits for an hour without saying so";
}

TEST(RetriesTest, AnInterruptEndsTheWaitAtOnce) {
  base::Cancellation interrupt;
  Answers answers({Refusal(absl::Minutes(2))});
  std::thread canceller([&] {
    absl::SleepFor(absl::Milliseconds(20));
    interrupt.Cancel();
  });
  EXPECT_THAT(CallWithRetries(base::MonotonicTime::InfiniteFuture(), interrupt, std::ref(answers)),
              StatusIs(absl::StatusCode::kCancelled));
  canceller.join();
}

}  // namespace
}  // namespace isoscope::client
