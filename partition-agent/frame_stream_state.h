// The order of the messages of one frame on an agent, apart from steps, threads and gRPC.
//
//   phase                 event           the call's action                    next phase
//   kExpectBegin          kBegin          admits the frame, schedules steps    kSelecting
//   kSelecting            kAnswer         sends ray_hits                       kExpectOccluders
//                         kDrawsAll       draws all active blocks              kRenderingRest
//   kExpectOccluders      kOccluders      schedules step 2                     kRenderingOccluders
//   kRenderingOccluders   kAnswer         sends bands, occluders_done          kExpectVisibleBlocks
//   kExpectVisibleBlocks  kVisibleBlocks  schedules step 3                     kRenderingRest
//   kRenderingRest        kAnswer         sent bands, frame_done; ends OK      kEnded
//   any but kEnded        End             stops the step, ends with the error  kEnded
//
// A message in any other phase is INVALID_ARGUMENT. So is the end of the coordinator's messages
// before kRenderingRest; after that it is ignored. Once the frame has ended, events of a step that
// still runs are ignored.

#ifndef ISOSCOPE_PARTITION_AGENT_FRAME_STREAM_STATE_H_
#define ISOSCOPE_PARTITION_AGENT_FRAME_STREAM_STATE_H_

#include <utility>

#include "absl/status/status.h"

namespace isoscope::agent {

// Thread-compatible.
class FrameStreamState {
 public:
  enum class Event {
    // Messages of the coordinator, and their end.
    kBegin,
    kOccluders,
    kVisibleBlocks,
    kEmptyMessage,
    kMessagesEnd,
    // Events of the running step: it draws the whole frame (CULLING_NONE), or its answer is ready.
    kDrawsAll,
    kAnswer,
  };

  // Enters the next phase. If the coordinator's message, or the end of its messages, is not due,
  // returns INVALID_ARGUMENT and keeps the phase.
  absl::Status Apply(Event event);
  // Ends the frame. Returns false if it had ended already.
  bool End() { return std::exchange(phase_, Phase::kEnded) != Phase::kEnded; }

 private:
  // In kExpect... a message of the coordinator is due. In the others a step runs, until kEnded.
  enum class Phase {
    kExpectBegin,
    kSelecting,
    kExpectOccluders,
    kRenderingOccluders,
    kExpectVisibleBlocks,
    kRenderingRest,
    kEnded,
  };
  struct Transition;
  static const Transition kTransitions[];

  Phase phase_ = Phase::kExpectBegin;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_FRAME_STREAM_STATE_H_
