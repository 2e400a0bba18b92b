// What an agent lets in once it stops, and how long it waits: calls of frames that have begun go on,
// however long the agent has nothing to do for them.

#include "partition-agent/begun_frames.h"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <thread>

#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "tests/support/status_matchers.h"

namespace isoscope::agent {
namespace {

using ::testing::HasSubstr;
using testing::IsOk;
using testing::StatusIs;

auto IsRefused() { return StatusIs(absl::StatusCode::kUnavailable, HasSubstr("the agent stops")); }

base::MonotonicTime In(absl::Duration duration) { return base::MonotonicNow() + duration; }

// Between calls an entry lives for an hour here, so that no test depends on time.
class BegunFramesTest : public ::testing::Test {
 protected:
  BegunFrames begun_{absl::Hours(1)};
};

TEST_F(BegunFramesTest, BeforeItStopsEverythingIsLetIn) {
  EXPECT_THAT(begun_.BeginFrame("a", 1), IsOk());
  EXPECT_THAT(begun_.BeginFrame("a", 2), IsOk());
  EXPECT_THAT(begun_.BeginQuestion("b"), IsOk());
  EXPECT_THAT(begun_.CheckNotStopping(), IsOk());
}

TEST_F(BegunFramesTest, AfterThatOnlyCallsOfFramesThatHaveBegun) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BegunFrames::Call in_work, begun_.BeginFrame("a", 1));
  ISOSCOPE_ASSERT_OK(begun_.BeginFrame("b", 7));  // between two calls
  EXPECT_EQ(begun_.Stop(), 2);
  EXPECT_THAT(begun_.BeginFrame("a", 1), IsOk());
  EXPECT_THAT(begun_.BeginFrame("b", 7), IsOk());
  EXPECT_THAT(begun_.BeginQuestion("b"), IsOk());
  EXPECT_THAT(begun_.BeginFrame("a", 2), IsRefused()) << "another frame of an interactive stream";
  EXPECT_THAT(begun_.BeginFrame("c", 1), IsRefused());
  EXPECT_THAT(begun_.BeginQuestion("c"), IsRefused());
  EXPECT_THAT(begun_.CheckNotStopping(), IsRefused());
}

TEST_F(BegunFramesTest, AQuestionBeginsTheFrameOfItsRequest) {
  ISOSCOPE_ASSERT_OK(begun_.BeginQuestion("a"));
  begun_.Stop();
  EXPECT_THAT(begun_.BeginFrame("a", 1), IsOk());
  EXPECT_THAT(begun_.BeginFrame("a", 1), IsOk());
}

// Else a stream that asks before each frame would keep the agent.
TEST_F(BegunFramesTest, AQuestionAfterItStopsBeginsNoOtherFrame) {
  ISOSCOPE_ASSERT_OK(begun_.BeginFrame("a", 1));
  begun_.Stop();
  ISOSCOPE_ASSERT_OK(begun_.BeginQuestion("a"));
  EXPECT_THAT(begun_.BeginFrame("a", 2), IsRefused());
}

TEST_F(BegunFramesTest, WaitsForCallsThatFollow) {
  BegunFrames begun{absl::ZeroDuration()};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(std::optional<BegunFrames::Call> first, begun.BeginFrame("a", 1));
  first->ExpectOthersUntil(In(absl::Hours(1)));
  first.reset();
  EXPECT_EQ(begun.Stop(), 1);
  begun.AwaitEnd(In(absl::Milliseconds(1)));
  EXPECT_THAT(begun.BeginQuestion("a"), IsOk()) << "given up, although others follow";
  begun.AwaitEnd(In(absl::Milliseconds(1)));
  EXPECT_THAT(begun.BeginFrame("a", 1), IsOk()) << "a question has ended it";
  // That was the last.
  begun.AwaitEnd(In(absl::Hours(1)));
  EXPECT_THAT(begun.BeginFrame("a", 1), IsRefused());
}

TEST_F(BegunFramesTest, WaitsForCallsInWorkAndNotForOneThatNeverComes) {
  BegunFrames begun{absl::ZeroDuration()};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(std::optional<BegunFrames::Call> call, begun.BeginFrame("a", 1));
  begun.Stop();
  std::thread other([&call] { call.reset(); });
  begun.AwaitEnd(base::MonotonicTime::InfiniteFuture());
  other.join();
  EXPECT_FALSE(call.has_value());
  // A coordinator that died, or whose client left, between two bands: the frame's deadline passes.
  BegunFrames left{absl::ZeroDuration()};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(call, left.BeginFrame("a", 1));
  call->ExpectOthersUntil(In(absl::Milliseconds(1)));
  call.reset();
  left.Stop();
  left.AwaitEnd(base::MonotonicTime::InfiniteFuture());
  EXPECT_THAT(left.BeginFrame("a", 1), IsRefused());
}

// Symptom: an agent that stopped waited for a band whose client had left.
TEST_F(BegunFramesTest, WaitsNoLongerOnceItHearsThatNoCallFollows) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(std::optional<BegunFrames::Call> call, begun_.BeginFrame("a", 1));
  call->ExpectOthersUntil(base::MonotonicTime::InfiniteFuture());
  call.reset();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(call, begun_.BeginFrame("a", 2));
  call->ExpectOthersUntil(base::MonotonicTime::InfiniteFuture());
  EXPECT_EQ(begun_.Stop(), 2);
  std::thread coordinator([this] {
    begun_.EndFrame("a", 1);
    begun_.EndFrame("b", 2);  // of another request
    begun_.EndFrame("a", 3);  // that has not begun
  });
  coordinator.join();
  EXPECT_THAT(begun_.BeginFrame("a", 1), IsRefused());
  begun_.AwaitEnd(In(absl::Milliseconds(1)));
  EXPECT_THAT(begun_.BeginQuestion("a"), IsOk()) << "frame 2 has not ended";
  // The word comes before the agent is done with the call, whose answer the coordinator has.
  begun_.EndFrame("a", 2);
  std::thread last([&call] { call.reset(); });
  begun_.AwaitEnd(base::MonotonicTime::InfiniteFuture());
  last.join();
  EXPECT_THAT(begun_.BeginFrame("a", 2), IsRefused());
}

TEST_F(BegunFramesTest, ACallThatComesAllTheSameIsWaitedFor) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BegunFrames::Call first, begun_.BeginFrame("a", 1));
  begun_.EndFrame("a", 1);
  begun_.Stop();
  ISOSCOPE_ASSERT_OK(begun_.BeginFrame("a", 1));
  begun_.AwaitEnd(In(absl::Milliseconds(1)));
  EXPECT_THAT(begun_.BeginFrame("a", 1), IsOk());
}

TEST_F(BegunFramesTest, ForgetsThoseThatEndFirstBeyondItsBound) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BegunFrames::Call in_work, begun_.BeginFrame("in work", 1));
  for (std::size_t i = 0; i < BegunFrames::kMaxEntries; ++i) {
    ISOSCOPE_ASSERT_OK(begun_.BeginFrame("a", static_cast<std::int64_t>(i)));
  }
  EXPECT_EQ(begun_.Stop(), BegunFrames::kMaxEntries);
  EXPECT_THAT(begun_.BeginFrame("in work", 1), IsOk());
  EXPECT_THAT(begun_.BeginFrame("a", 0), IsRefused());
  EXPECT_THAT(begun_.BeginFrame("a", 1), IsOk());
}

}  // namespace
}  // namespace isoscope::agent
