// A frame's stream: FrameStreamState decides which message is due, FrameAnswerer answers it, and
// this call runs the steps and sends the answers.
//
// gRPC calls the reactions (OnReadDone, OnCancel, ...) on its threads; they only check and
// schedule. A step runs on the frame executor, and a frame has at most one step there. A step
// enters kExpect... before it sends its answer, because the coordinator may reply at once.

#include <algorithm>
#include <cstdint>
#include <memory>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

#include "core/base/log.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/retry_delay.h"
#include "core/base/status_macros.h"
#include "core/base/trace_context.h"
#include "partition-agent/agent_streams.h"
#include "partition-agent/begun_frames.h"
#include "partition-agent/frame/step_memory.h"
#include "partition-agent/frame_answerer.h"
#include "partition-agent/frame_stream_state.h"
#include "partition-agent/frame_trace.h"
#include "proto/message_checksum.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/request_context.h"
#include "rpc/unary_call.h"
#include "rpc/write_queue.h"

namespace isoscope::agent {
namespace {

namespace v1 = isoscope::internal::v1;
using Event = FrameStreamState::Event;

Event EventOf(const v1::RenderFrameRequest& message) {
  switch (message.message_case()) {
    case v1::RenderFrameRequest::kBegin:
      return Event::kBegin;
    case v1::RenderFrameRequest::kOccluders:
      return Event::kOccluders;
    case v1::RenderFrameRequest::kVisibleBlocks:
      return Event::kVisibleBlocks;
    case v1::RenderFrameRequest::MESSAGE_NOT_SET:
      break;
  }
  return Event::kEmptyMessage;
}

// No frame: only the end of one between calls.
bool SaysThatNoneFollows(const v1::RenderFrameRequest& message) {
  return message.has_begin() && !message.begin().has_frame() &&
         message.begin().shard_indices().empty();
}

// The number of a frame among those that have begun.
std::int64_t BegunNumberOf(std::int64_t frame_number) {
  return std::max(frame_number, std::int64_t{0});
}

// One frame. It owns itself until gRPC is done with it. A running step shares it.
class RenderFrameCall final : public FrameReactor {
 public:
  static RenderFrameCall* Start(AgentContext* agent, grpc::CallbackServerContext* context) {
    std::shared_ptr<RenderFrameCall> call(new RenderFrameCall(agent, context));
    call->self_ = call;
    call->StartRead(&call->incoming_);
    return call.get();
  }

  ~RenderFrameCall() override {
    begun_ = BegunFrames::Call();  // before it is seen that the frame is not in work
    if (is_admitted_) {
      agent_.frame_count.fetch_sub(1);
    }
  }

  void OnReadDone(bool ok) override {
    if (!ok) {
      OnReadsEnded();
      return;
    }
    trace_.NoteReceived(incoming_);
    v1::RenderFrameRequest message;
    message.Swap(&incoming_);
    absl::Status status = proto::CheckIntact(message);
    if (status.ok() && SaysThatNoneFollows(message)) {
      status = EndFrame(message.begin().frame_number());
      if (status.ok()) {
        return;
      }
    } else if (status.ok()) {
      status = Accept(std::move(message));
    }
    if (!status.ok()) {
      Fail(status);
      return;
    }
    StartRead(&incoming_);
  }

  void OnWriteDone(bool ok) override { outgoing_.OnWriteDone(ok); }

  void OnCancel() override {
    outgoing_.Close();
    Fail(absl::CancelledError("the coordinator cancelled the frame, or its deadline passed"));
  }

  void OnDone() override { const std::shared_ptr<RenderFrameCall> last_use = std::move(self_); }

 private:
  RenderFrameCall(AgentContext* agent, grpc::CallbackServerContext* context)
      : agent_(*agent),
        context_(context),
        identity_(rpc::AnswerTraceContext(context)),
        cancellation_(rpc::DeadlineOf(*context)),
        outgoing_(
            kMaxQueuedBytes,
            [this](const v1::RenderFrameResponse* message) { StartWrite(message); },
            [this](const absl::Status& status) {
              agent_.metrics.CountRequest(AgentMethod::kRenderFrame, status,
                                          base::MonotonicNow() - start_);
              Finish(rpc::ToGrpcStatus(status));
            }),
        steps_(agent, &cancellation_, &trace_,
               [this](v1::RenderFrameResponse bands) { return Send(std::move(bands)); }) {}

  // Checks that the message is due, and schedules its step.
  absl::Status Accept(v1::RenderFrameRequest message) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    ISOSCOPE_RETURN_IF_ERROR(state_.Apply(EventOf(message)));
    if (message.has_begin()) {
      ISOSCOPE_RETURN_IF_ERROR(Admit());
      frame_number_ = message.begin().frame_number();
      ISOSCOPE_ASSIGN_OR_RETURN(
          begun_, agent_.begun.BeginFrame(identity_.request_id(), BegunNumberOf(frame_number_)));
      others_follow_ = message.begin().others_follow();
    }
    return Schedule(std::move(message));
  }

  // Ends the call as well.
  absl::Status EndFrame(std::int64_t frame_number) ABSL_LOCKS_EXCLUDED(mutex_) {
    {
      const base::MutexLock lock(&mutex_);
      ISOSCOPE_RETURN_IF_ERROR(state_.Apply(Event::kBegin));
      state_.End();
    }
    agent_.begun.EndFrame(identity_.request_id(), BegunNumberOf(frame_number));
    outgoing_.Finish(absl::OkStatus());
    return absl::OkStatus();
  }

  absl::Status Admit() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const int before = agent_.frame_count.fetch_add(1);
    is_admitted_ = true;
    if (before >= agent_.max_frames) {
      return base::WithRetryDelay(
          absl::ResourceExhaustedError(absl::StrCat(
              before,
              " frames are in work or wait, the most this agent takes (--max-concurrent-frames "
              "plus its queue): retry later")),
          rpc::UnaryTask::kBusyDelay);
    }
    return absl::OkStatus();
  }

  // The executor always has room for one step of each admitted frame.
  absl::Status Schedule(v1::RenderFrameRequest message) {
    const base::MonotonicTime scheduled = base::MonotonicNow();
    const base::TraceTime trace_scheduled =
        trace_.recorder() == nullptr ? base::TraceTime() : base::TraceClock::now();
    const bool is_scheduled = agent_.frame_executor.TrySchedule(
        [call = self_, scheduled, trace_scheduled, message = std::move(message)] {
          call->agent_.metrics.queue_wait.Observe(base::MonotonicNow() - scheduled);
          if (base::TraceRecorder* const recorder = call->trace_.recorder(); recorder != nullptr) {
            recorder->NameThisThread("frame");
            recorder->AddTo("queue", "queue", trace_scheduled, base::TraceClock::now());
          }
          // Begin and Encode may throw, and so may protobuf; `message` is only destroyed.
          const absl::Status status = OrNoMemoryForStep([&] { return call->RunSteps(message); });
          if (!status.ok()) {
            call->Fail(status);
          }
        });
    return is_scheduled ? absl::OkStatus() : absl::UnavailableError("the agent is shutting down");
  }

  absl::Status RunSteps(const v1::RenderFrameRequest& message) {
    if (message.has_occluders()) {
      return Answer(steps_.RenderOccluders(message.occluders()));
    }
    if (message.has_visible_blocks()) {
      return Answer(steps_.RenderVisible(message.visible_blocks()));
    }
    ISOSCOPE_RETURN_IF_ERROR(steps_.Begin(message.begin()));
    if (!steps_.draws_all()) {
      return Answer(steps_.SelectOccluders());
    }
    ISOSCOPE_RETURN_IF_ERROR(Apply(Event::kDrawsAll));
    return Answer(steps_.RenderAll());
  }

  // Sends the answer of a step. The last one ends the stream.
  absl::Status Answer(absl::StatusOr<v1::RenderFrameResponse> answer) {
    ISOSCOPE_RETURN_IF_ERROR(answer.status());
    if (!answer->has_frame_done()) {
      ISOSCOPE_RETURN_IF_ERROR(Apply(Event::kAnswer));
      return Send(*std::move(answer));
    }
    trace_.MoveTo(answer->mutable_frame_done());
    ISOSCOPE_RETURN_IF_ERROR(Send(*std::move(answer)));
    ISOSCOPE_RETURN_IF_ERROR(Apply(Event::kAnswer));
    if (others_follow_) {
      begun_.ExpectOthersUntil(
          std::min(cancellation_.deadline(), base::MonotonicNow() + BegunFrames::kBetweenCalls));
    }
    outgoing_.Finish(absl::OkStatus());
    const frame::AgentStatistics& statistics = steps_.statistics();
    agent_.metrics.triangles.Add(statistics.triangle_count);
    agent_.metrics.drawn_blocks.Add(statistics.visible_block_count);
    agent_.metrics.CountFrame(absl::OkStatus(), statistics.busy_duration);
    base::LogDebug("frame_done",
                   {{"request", identity_.request_id()},
                    {"frame", frame_number_},
                    {"duration_ms", base::LogMilliseconds(base::MonotonicNow() - start_)},
                    {"busy_ms", base::LogMilliseconds(statistics.busy_duration)},
                    {"active_blocks", statistics.active_block_count},
                    {"visible_blocks", statistics.visible_block_count},
                    {"triangles", statistics.triangle_count}});
    steps_.Release();  // frees memory for the next frame before this call ends
    return absl::OkStatus();
  }

  absl::Status Apply(Event event) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    return state_.Apply(event);
  }

  absl::Status Send(v1::RenderFrameResponse message) {
    const base::TraceScope trace(trace_.recorder(), "send");
    if (!message.has_frame_done()) {  // FrameTrace::MoveTo noted that one
      trace_.NoteSent();
    }
    if (outgoing_.Push(std::move(message))) {
      return absl::OkStatus();
    }
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    return absl::CancelledError("the stream has ended");
  }

  void OnReadsEnded() {
    if (context_->IsCancelled()) {
      return;  // OnCancel ends the frame
    }
    const absl::Status status = Apply(Event::kMessagesEnd);
    if (!status.ok()) {
      Fail(status);
    }
  }

  // Ends the frame with an error. Only the first error counts.
  void Fail(const absl::Status& error) ABSL_LOCKS_EXCLUDED(mutex_) {
    std::int64_t frame_number = 0;
    bool is_admitted = false;
    {
      const base::MutexLock lock(&mutex_);
      if (!state_.End()) {
        return;
      }
      frame_number = frame_number_;
      is_admitted = is_admitted_;
    }
    cancellation_.Cancel();  // a step may still run
    const absl::Status status = agent_.damages.ForCaller(error);
    outgoing_.Finish(status);
    if (is_admitted) {
      agent_.metrics.CountFrame(status, absl::ZeroDuration());
    }
    const bool is_cancelled = absl::IsCancelled(status);
    base::Log(is_cancelled ? base::LogLevel::kDebug : base::LogLevel::kWarning,
              is_cancelled ? "frame_cancelled" : "frame_failed",
              {{"request", identity_.request_id()},
               {"frame", frame_number},
               {"duration_ms", base::LogMilliseconds(base::MonotonicNow() - start_)},
               {"status", status}});
  }

  AgentContext& agent_;
  grpc::CallbackServerContext* const context_;
  const base::TraceContext identity_;
  const base::MonotonicTime start_ = base::MonotonicNow();
  base::Cancellation cancellation_;
  rpc::WriteQueue<v1::RenderFrameResponse> outgoing_;
  v1::RenderFrameRequest incoming_;
  std::shared_ptr<RenderFrameCall> self_;  // reset by OnDone
  base::Mutex mutex_;
  FrameStreamState state_ ABSL_GUARDED_BY(mutex_);
  std::int64_t frame_number_ = 0;  // set before the first step
  bool is_admitted_ = false;       // the same
  BegunFrames::Call begun_;        // the same
  bool others_follow_ = false;     // the same
  FrameTrace trace_;
  FrameAnswerer steps_;  // the steps use it, one after the other
};

}  // namespace

FrameReactor* StartRenderFrame(AgentContext* agent, grpc::CallbackServerContext* context) {
  return RenderFrameCall::Start(agent, context);
}

}  // namespace isoscope::agent
