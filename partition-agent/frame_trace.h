// The spans of one frame on an agent, and the times of its messages, if the coordinator asks for
// them.

#ifndef ISOSCOPE_PARTITION_AGENT_FRAME_TRACE_H_
#define ISOSCOPE_PARTITION_AGENT_FRAME_TRACE_H_

#include <memory>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"

#include "core/base/mutex.h"
#include "core/base/trace_recorder.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "wire/trace_convert.h"

namespace isoscope::agent {

// The thread that receives calls NoteReceived; the step in work calls the other functions. A step
// may run while the next message is received.
class FrameTrace {
 public:
  // Begins a trace if this is the frame's first message and asks for one, and notes its arrival.
  void NoteReceived(const isoscope::internal::v1::RenderFrameRequest& message)
      ABSL_LOCKS_EXCLUDED(mutex_) {
    if (std::exchange(is_first_, false) && message.has_begin() && message.begin().with_trace()) {
      recorder_ = std::make_unique<base::TraceRecorder>(
          wire::MaxSpansOfAgent(message.begin().agent_count()));
      zero_ = base::TraceClock::now();
    }
    if (recorder_ != nullptr) {
      const base::MutexLock lock(&mutex_);
      received_.push_back(base::TraceClock::now());
    }
  }

  void NoteSent() {
    if (recorder_ != nullptr) {
      sent_.push_back(base::TraceClock::now());
    }
  }

  // Moves the times into the last message, and notes that it is sent. Later times are not included.
  void MoveTo(isoscope::internal::v1::FrameDone* done) ABSL_LOCKS_EXCLUDED(mutex_) {
    if (recorder_ == nullptr) {
      return;
    }
    wire::MessageTimes times;
    {
      const base::MutexLock lock(&mutex_);
      times.received = received_;
    }
    const base::RecordedTrace recorded = recorder_->Get();
    NoteSent();
    times.sent = std::move(sent_);
    *done->mutable_trace() = wire::ToProto(recorded, times, zero_);
  }

  // Null: the frame has no trace. Does not change after the first message.
  [[nodiscard]] base::TraceRecorder* recorder() const { return recorder_.get(); }

 private:
  bool is_first_ = true;
  std::unique_ptr<base::TraceRecorder> recorder_;
  base::TraceTime zero_;
  std::vector<base::TraceTime> sent_;
  base::Mutex mutex_;
  std::vector<base::TraceTime> received_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_FRAME_TRACE_H_
