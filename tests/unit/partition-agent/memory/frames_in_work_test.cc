#include "partition-agent/memory/frames_in_work.h"

#include <atomic>
#include <optional>
#include <thread>

#include "absl/time/clock.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "tests/support/status_matchers.h"

namespace isoscope::agent {
namespace {

using isoscope::testing::StatusIs;

constexpr absl::Duration kAWhile = absl::Milliseconds(20);

TEST(FramesInWorkTest, WaitsUntilNoFrameIsInWork) {
  FramesInWork frames;
  const base::Cancellation never;
  ISOSCOPE_EXPECT_OK(frames.AwaitIdle(never, kAWhile)) << "there was no frame yet";
  std::optional<FramesInWork::Frame> first(std::in_place, &frames);
  std::optional<FramesInWork::Frame> second(std::in_place, &frames);
  std::atomic<bool> is_idle = false;
  std::thread waiting([&] {
    ISOSCOPE_EXPECT_OK(frames.AwaitIdle(never, kAWhile));
    is_idle = true;
  });
  first.reset();
  absl::SleepFor(kAWhile);
  EXPECT_FALSE(is_idle);
  const base::MonotonicTime end = base::MonotonicNow();
  second.reset();
  waiting.join();
  EXPECT_GE(base::MonotonicNow() - end, kAWhile);
}

TEST(FramesInWorkTest, ACancellationEndsBothWaits) {
  FramesInWork frames;
  const FramesInWork::Frame frame(&frames);
  const FramesInWork::DiskWait disk_wait(&frames);
  base::Cancellation cancellation;
  std::thread idle([&] {
    EXPECT_THAT(frames.AwaitIdle(cancellation, absl::ZeroDuration()),
                StatusIs(absl::StatusCode::kCancelled));
  });
  std::thread disk([&] {
    EXPECT_THAT(frames.AwaitIdleDisk(cancellation), StatusIs(absl::StatusCode::kCancelled));
  });
  absl::SleepFor(kAWhile);
  cancellation.Cancel();
  idle.join();
  disk.join();
}

TEST(FramesInWorkTest, AFrameInterruptsWork) {
  FramesInWork frames;
  base::Cancellation work;
  {
    const FramesInWork::Interruption interruption(&frames, &work);
    EXPECT_FALSE(work.is_cancelled());
    const FramesInWork::Frame frame(&frames);
    EXPECT_TRUE(work.is_cancelled());
    base::Cancellation late;
    const FramesInWork::Interruption at_once(&frames, &late);
    EXPECT_TRUE(late.is_cancelled());
  }
  base::Cancellation other;
  { const FramesInWork::Interruption ended(&frames, &other); }
  const FramesInWork::Frame frame(&frames);
  EXPECT_FALSE(other.is_cancelled());
}

TEST(FramesInWorkTest, WaitsUntilNoFrameWaitsForTheDisk) {
  FramesInWork frames;
  const base::Cancellation never;
  ISOSCOPE_EXPECT_OK(frames.AwaitIdleDisk(never));
  std::optional<FramesInWork::DiskWait> disk_wait(std::in_place, &frames);
  std::atomic<bool> is_idle = false;
  std::thread waiting([&] {
    ISOSCOPE_EXPECT_OK(frames.AwaitIdleDisk(never));
    is_idle = true;
  });
  absl::SleepFor(kAWhile);
  EXPECT_FALSE(is_idle);
  disk_wait.reset();
  waiting.join();
  const FramesInWork::DiskWait of_nobody(nullptr);
}

}  // namespace
}  // namespace isoscope::agent
