#include "server/frame_runner.h"

#include <memory>
#include <optional>
#include <utility>

#include "absl/synchronization/notification.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/task_arena.h"
#include "tests/support/status_matchers.h"

namespace isoscope::server {
namespace {

using isoscope::testing::StatusIs;
using ::testing::HasSubstr;

// What needs agents is tested by isosurface_service_test and planes_test.
FrameRunnerOptions Options() {
  FrameRunnerOptions options;
  options.max_concurrent_frames = 1;
  options.max_queued_frames = 1;
  options.arena = base::MakeTaskArena(1);
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
  auto first = runner.Admit(SpecOf(64), Delivery::kWhole);
  ISOSCOPE_ASSERT_OK(first);
  {
    auto second = runner.Admit(SpecOf(64), Delivery::kWhole);
    ISOSCOPE_ASSERT_OK(second);
    EXPECT_THAT(runner.Admit(SpecOf(64), Delivery::kWhole),
                StatusIs(absl::StatusCode::kResourceExhausted,
                         HasSubstr("1 frames are in work and 1 wait")));
  }
  ISOSCOPE_EXPECT_OK(runner.Admit(SpecOf(64), Delivery::kWhole));
}

TEST(FrameRunnerTest, AFrameAboveTheMemoryLimitTakesNoPlace) {
  FrameRunner runner(Options());
  for (int i = 0; i < 5; ++i) {
    EXPECT_THAT(runner.Admit(SpecOf(16384), Delivery::kWhole),
                StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("16384 x 16384")));
  }
  ISOSCOPE_EXPECT_OK(runner.Admit(SpecOf(64), Delivery::kWhole));
}

TEST(FrameRunnerTest, ScheduledWorkRuns) {
  FrameRunner runner(Options());
  absl::Notification ran;
  runner.Schedule([&] { ran.Notify(); });
  ran.WaitForNotification();
}

}  // namespace
}  // namespace isoscope::server
