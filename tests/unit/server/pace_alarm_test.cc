#include "server/pace_alarm.h"

#include <memory>

#include "absl/synchronization/notification.h"
#include "absl/time/time.h"
#include <grpcpp/alarm.h>
#include <gtest/gtest.h>

#include "server/admission/export_pace.h"

namespace isoscope::server {
namespace {

TEST(PaceAlarmTest, AfterStopNothingHoldsWhatRings) {
  // gRPC's threads drop the callback of a cancelled alarm later: after the call and its service. They
  // run while there is anything of gRPC, as in a server: without this one, its last user joins them.
  const grpc::Alarm keeps_grpc_running;
  for (int i = 0; i < 100; ++i) {
    const auto call = std::make_shared<int>(0);
    PaceAlarm alarm;
    alarm.Start(ExportLimits(), [call] { ++*call; });
    alarm.Stop();
    ASSERT_EQ(call.use_count(), 1);
  }
}

TEST(PaceAlarmTest, AStartAfterStopIsNone) {
  const auto call = std::make_shared<int>(0);
  PaceAlarm alarm;
  alarm.Stop();
  alarm.Start(ExportLimits(), [call] { ++*call; });
  EXPECT_EQ(call.use_count(), 1);
}

TEST(PaceAlarmTest, AClientThatIsTooSlowIsJudged) {
  PaceAlarm alarm;
  absl::Notification is_too_slow;
  alarm.Start({.allowance = absl::Milliseconds(10)}, [&] {
    if (alarm.Judge() == ExportPace::Verdict::kTooSlow) {
      is_too_slow.Notify();
    }
  });
  alarm.OnWriteBegun(1);
  is_too_slow.WaitForNotification();
  alarm.Stop();
}

}  // namespace
}  // namespace isoscope::server
