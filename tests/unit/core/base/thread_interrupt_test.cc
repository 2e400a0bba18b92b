#include "core/base/thread_interrupt.h"

#include <thread>

#include "absl/time/time.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "core/base/process_interrupt.h"
#include "tests/support/status_matchers.h"

namespace isoscope::base {
namespace {

using ::isoscope::testing::StatusIs;

TEST(ThreadInterruptTest, FiresForItsThreadAloneWhileItLives) {
  Cancellation frame;
  {
    const ThreadInterrupt interrupt(frame);
    ISOSCOPE_EXPECT_OK(CheckProcessInterrupt());
    frame.Cancel();
    EXPECT_THAT(CheckProcessInterrupt(), StatusIs(absl::StatusCode::kCancelled));
    EXPECT_FALSE(InterruptOfAllThreads().is_cancelled());
    std::thread([] { ISOSCOPE_EXPECT_OK(CheckProcessInterrupt()); }).join();
  }
  ISOSCOPE_EXPECT_OK(CheckProcessInterrupt());
}

TEST(ThreadInterruptTest, TheProcessAndOuterOnesFireItToo) {
  Cancellation process;
  SetProcessInterrupt(&process);
  const Cancellation frame;
  Cancellation inner_frame;
  {
    const ThreadInterrupt outer(frame);
    {
      const ThreadInterrupt inner(inner_frame);
      inner_frame.Cancel();
      EXPECT_TRUE(ProcessInterrupt().is_cancelled());
    }
    EXPECT_FALSE(ProcessInterrupt().is_cancelled());
    const ThreadInterrupt inner(frame);
    process.Cancel();
    EXPECT_TRUE(ProcessInterrupt().is_cancelled());
  }
  EXPECT_EQ(&ProcessInterrupt(), &process);
  EXPECT_EQ(&InterruptOfAllThreads(), &process);
  SetProcessInterrupt(nullptr);
}

TEST(ThreadInterruptTest, HasTheNearestDeadline) {
  const MonotonicTime soon = MonotonicNow() + absl::Seconds(100);
  const Cancellation near(soon);
  const Cancellation far(soon + absl::Seconds(100));
  const ThreadInterrupt outer(near);
  EXPECT_EQ(ProcessInterrupt().deadline(), soon);
  const ThreadInterrupt inner(far);
  EXPECT_EQ(ProcessInterrupt().deadline(), soon);
}

}  // namespace
}  // namespace isoscope::base
