#include "partition-agent/frame_stream_state.h"

#include <algorithm>
#include <string>
#include <vector>

#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::agent {
namespace {

using testing::StatusIs;
using Event = FrameStreamState::Event;
using enum FrameStreamState::Event;

constexpr Event kEventsOfCoordinator[] = {kBegin, kOccluders, kVisibleBlocks, kEmptyMessage,
                                          kMessagesEnd};
const char* const kNames[] = {"begin", "occluders", "visible_blocks", "(none)"};
constexpr char kEarlyEnd[] = "the coordinator ended its side before the frame was done";

struct Case {
  std::vector<Event> before;
  std::string due;           // how a message that is not due is refused
  std::vector<Event> takes;  // events of the coordinator that are due
};

// Every phase, by the ways that lead there, with each event of the coordinator.
TEST(FrameStreamStateTest, OnlyWhatIsDueIsTaken) {
  const std::string none = "no message was expected before the agent's answer";
  const std::vector<Case> cases = {
      {{}, "begin was expected", {kBegin}},
      {{kBegin}, none, {}},
      {{kBegin, kAnswer}, "occluders was expected", {kOccluders}},
      {{kBegin, kAnswer, kOccluders}, none, {}},
      {{kBegin, kAnswer, kOccluders, kAnswer}, "visible_blocks was expected", {kVisibleBlocks}},
      {{kBegin, kAnswer, kOccluders, kAnswer, kVisibleBlocks}, none, {kMessagesEnd}},
      {{kBegin, kAnswer, kOccluders, kAnswer, kVisibleBlocks, kAnswer}, none, {kMessagesEnd}},
      {{kBegin, kDrawsAll}, none, {kMessagesEnd}},
      {{kBegin, kDrawsAll, kAnswer}, none, {kMessagesEnd}},
  };
  for (std::size_t i = 0; i < cases.size(); ++i) {
    for (const Event event : kEventsOfCoordinator) {
      SCOPED_TRACE(::testing::Message() << "case " << i << ", event " << static_cast<int>(event));
      FrameStreamState state;
      for (const Event before : cases[i].before) {
        ISOSCOPE_ASSERT_OK(state.Apply(before));
      }
      const auto& takes = cases[i].takes;
      if (std::find(takes.begin(), takes.end(), event) != takes.end()) {
        ISOSCOPE_EXPECT_OK(state.Apply(event));
        continue;
      }
      const std::string expected =
          event == kMessagesEnd
              ? kEarlyEnd
              : std::string("message ") + kNames[static_cast<int>(event)] + ", but " + cases[i].due;
      // A refusal changes nothing.
      for (int times = 0; times < 2; ++times) {
        EXPECT_EQ(state.Apply(event), absl::InvalidArgumentError(expected));
      }
    }
  }
}

TEST(FrameStreamStateTest, AFrameEndsOnceAndAStepThatStillRunsMeansNothing) {
  for (const std::vector<Event>& before :
       std::vector<std::vector<Event>>{{}, {kBegin}, {kBegin, kAnswer}, {kBegin, kDrawsAll}}) {
    FrameStreamState state;
    for (const Event event : before) {
      ISOSCOPE_ASSERT_OK(state.Apply(event));
    }
    EXPECT_TRUE(state.End());
    EXPECT_FALSE(state.End());
    for (const Event event : {kAnswer, kDrawsAll, kMessagesEnd}) {
      ISOSCOPE_EXPECT_OK(state.Apply(event));
    }
    EXPECT_THAT(state.Apply(kOccluders), StatusIs(absl::StatusCode::kInvalidArgument));
    EXPECT_FALSE(state.End());
  }
  FrameStreamState done;
  for (const Event event : {kBegin, kDrawsAll, kAnswer}) {
    ISOSCOPE_ASSERT_OK(done.Apply(event));
  }
  EXPECT_FALSE(done.End()) << "the last answer ends the frame";
}

}  // namespace
}  // namespace isoscope::agent
