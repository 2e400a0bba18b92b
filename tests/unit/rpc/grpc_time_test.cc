#include "rpc/grpc_time.h"

#include <thread>

#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gtest/gtest.h"
#include <grpcpp/alarm.h>
#include <grpcpp/client_context.h>

#include "core/base/absl_waits.h"
#include "tests/support/date_functions.h"

namespace isoscope::rpc {
namespace {

constexpr absl::Duration kStep = absl::Seconds(10);

TEST(GrpcTimeTest, MomentsComeBackAsTheyWere) {
  for (const absl::Duration wait : {absl::ZeroDuration(), absl::Hours(2), -absl::Hours(2)}) {
    const base::MonotonicTime time = base::MonotonicNow() + wait;
    EXPECT_LT(absl::AbsDuration(FromGrpcTime(ToGrpcTime(time)) - time), kStep) << wait;
  }
  for (const base::MonotonicTime time :
       {base::MonotonicTime::InfiniteFuture(), base::MonotonicTime::InfinitePast()}) {
    EXPECT_EQ(FromGrpcTime(ToGrpcTime(time)), time);
  }
}

TEST(GrpcTimeTest, DeadlinesAreOfTheMonotonicClock) {
  grpc::ClientContext context;
  context.set_deadline(base::MonotonicNow() + absl::Hours(2));
  EXPECT_EQ(context.raw_deadline().clock_type, GPR_CLOCK_MONOTONIC);
  testing::SetDateOffset(-3600);
  const absl::Duration left = FromGrpcTime(context.raw_deadline()) - base::MonotonicNow();
  testing::SetDateOffset(0);
  EXPECT_LT(absl::AbsDuration(left - absl::Hours(2)), absl::Minutes(30));
}

TEST(GrpcTimeTest, DatesOfGrpcAreRead) {
  const gpr_timespec date =
      gpr_time_add(gpr_now(GPR_CLOCK_REALTIME), gpr_time_from_hours(2, GPR_TIMESPAN));
  const absl::Duration left = FromGrpcTime(date) - base::MonotonicNow();
  EXPECT_LT(absl::AbsDuration(left - absl::Hours(2)), absl::Minutes(30));
  EXPECT_EQ(FromGrpcTime(gpr_inf_future(GPR_CLOCK_REALTIME)),
            base::MonotonicTime::InfiniteFuture());
}

// Without absl_waits.h it rings an hour later.
TEST(GrpcTimeTest, AnAlarmRingsThoughTheDateIsSetBack) {
  ASSERT_TRUE(base::AreAbslWaitsMonotonic());
  absl::Notification rang;
  grpc::Alarm alarm;
  alarm.Set(base::MonotonicNow() + absl::Milliseconds(500), [&](bool is_time) {
    EXPECT_TRUE(is_time);
    rang.Notify();
  });
  absl::SleepFor(absl::Milliseconds(100));
  testing::SetDateOffset(-3600);
  EXPECT_TRUE(rang.WaitForNotificationWithTimeout(absl::Minutes(5)));
  testing::SetDateOffset(0);
}

}  // namespace
}  // namespace isoscope::rpc
