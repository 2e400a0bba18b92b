#include "server/frame/frame_runner.h"

#include <memory>
#include <optional>
#include <utility>

#include "absl/synchronization/notification.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "core/base/task_arena.h"
#include "tests/support/status_matchers.h"

namespace isoscope::server {
namespace {

using isoscope::testing::StatusIs;
using ::testing::HasSubstr;

const char* const kClient = "peer ipv4:192.0.2.1:1";

// The functions that need agents are tested by isosurface_service_test and planes_test.
FrameRunnerOptions Options() {
  FrameRunnerOptions options;
  options.max_concurrent_frames = 1;
  options.max_queued_frames = 1;
  options.arena = std::make_shared<base::TaskArena>(1);
  options.memory_limit_bytes = CoordinatorMemory::kMinLimitBytes;
  return options;
}

frame::FrameSpec SpecOf(int side) {
  frame::FrameSpec spec;
  spec.viewport = {side, side};
  return spec;
}

TEST(FrameRunnerTest, APlaceIsFreeAgainWhenItIsGivenBack) {
  FrameRunner runner(Options());
  auto first = runner.Admit(kClient, SpecOf(64), Delivery::kWhole);
  ISOSCOPE_ASSERT_OK(first);
  {
    auto second = runner.Admit(kClient, SpecOf(64), Delivery::kWhole);
    ISOSCOPE_ASSERT_OK(second);
    EXPECT_THAT(runner.Admit(kClient, SpecOf(64), Delivery::kWhole),
                StatusIs(absl::StatusCode::kResourceExhausted,
                         HasSubstr("limits: 1 and 1; --max-concurrent-frames")));
  }
  ISOSCOPE_EXPECT_OK(runner.Admit(kClient, SpecOf(64), Delivery::kWhole));
}

TEST(FrameRunnerTest, AFrameAboveTheMemoryLimitTakesNoPlace) {
  FrameRunner runner(Options());
  for (int i = 0; i < 5; ++i) {
    EXPECT_THAT(runner.Admit(kClient, SpecOf(16384), Delivery::kWhole),
                StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("16384 x 16384")));
  }
  ISOSCOPE_EXPECT_OK(runner.Admit(kClient, SpecOf(64), Delivery::kWhole));
}

TEST(FrameRunnerTest, ScheduledWorkRuns) {
  FrameRunner runner(Options());
  absl::Notification ran;
  auto place = runner.Admit(kClient, SpecOf(64), Delivery::kWhole);
  ISOSCOPE_ASSERT_OK(place);
  runner.admission()->Schedule(place->ticket(), base::MonotonicTime::InfiniteFuture(),
                               [&](const absl::Status& turn) {
                                 ISOSCOPE_EXPECT_OK(turn);
                                 EXPECT_EQ(runner.gauges().waiting_clients, 0);
                                 ran.Notify();
                               });
  ran.WaitForNotification();
}

TEST(FrameRunnerTest, RefusalsAreCountedByReason) {
  FrameRunner runner(Options());
  const auto first = runner.Admit(kClient, SpecOf(64), Delivery::kWhole);
  const auto second = runner.Admit(kClient, SpecOf(64), Delivery::kWhole);
  EXPECT_FALSE(runner.Admit("b", SpecOf(64), Delivery::kWhole).ok());
  EXPECT_FALSE(runner.Admit("b", SpecOf(16384), Delivery::kWhole).ok());
  EXPECT_EQ(runner.metrics()->frames.refused.value(), 1);
  EXPECT_EQ(runner.metrics()->frames.too_large.value(), 1);
  EXPECT_EQ(runner.gauges().outside_clients, 1);
}

}  // namespace
}  // namespace isoscope::server
