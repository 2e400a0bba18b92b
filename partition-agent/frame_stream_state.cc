#include "partition-agent/frame_stream_state.h"

#include "absl/strings/str_cat.h"

#include "core/base/check.h"

namespace isoscope::agent {

struct FrameStreamState::Transition {
  Phase phase;
  Event event;
  Phase next;
};

const FrameStreamState::Transition FrameStreamState::kTransitions[] = {
    {Phase::kExpectBegin, Event::kBegin, Phase::kSelecting},
    {Phase::kSelecting, Event::kAnswer, Phase::kExpectOccluders},
    {Phase::kSelecting, Event::kDrawsAll, Phase::kRenderingRest},
    {Phase::kExpectOccluders, Event::kOccluders, Phase::kRenderingOccluders},
    {Phase::kRenderingOccluders, Event::kAnswer, Phase::kExpectVisibleBlocks},
    {Phase::kExpectVisibleBlocks, Event::kVisibleBlocks, Phase::kRenderingRest},
    {Phase::kRenderingRest, Event::kAnswer, Phase::kEnded},
};

absl::Status FrameStreamState::Apply(Event event) {
  for (const Transition& transition : kTransitions) {
    if (transition.phase == phase_ && transition.event == event) {
      phase_ = transition.next;
      return absl::OkStatus();
    }
  }
  const char* message = "(none)";
  switch (event) {
    case Event::kDrawsAll:
    case Event::kAnswer:
      ISOSCOPE_DCHECK(phase_ == Phase::kEnded);
      return absl::OkStatus();
    case Event::kMessagesEnd:
      return phase_ == Phase::kRenderingRest || phase_ == Phase::kEnded
                 ? absl::OkStatus()
                 : absl::InvalidArgumentError(
                       "the coordinator ended its side before the frame was done");
    case Event::kBegin:
      message = "begin";
      break;
    case Event::kOccluders:
      message = "occluders";
      break;
    case Event::kVisibleBlocks:
      message = "visible_blocks";
      break;
    case Event::kEmptyMessage:
      break;
  }
  const char* due = "no message was expected before the agent's answer";
  if (phase_ == Phase::kExpectBegin) {
    due = "begin was expected";
  } else if (phase_ == Phase::kExpectOccluders) {
    due = "occluders was expected";
  } else if (phase_ == Phase::kExpectVisibleBlocks) {
    due = "visible_blocks was expected";
  }
  return absl::InvalidArgumentError(absl::StrCat("message ", message, ", but ", due));
}

}  // namespace isoscope::agent
