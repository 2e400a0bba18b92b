// One stream is an InteractCall. Its events come on gRPC's threads (a message, the end of a write,
// the alarm, a cancellation) and on frame threads (a frame has ended). Each takes mutex_, tells the
// schedule, and then does what the schedule says (Proceed):
//
//   event                        tells               then
//   view state                   OnState             Proceed
//   frame shown                  OnShown, rate       Proceed
//   picture drawn                OnDrawn             Proceed
//   frame has ended              OnWorkEnded, rate   answer to outgoing_, Proceed
//   alarm                        -                   Proceed
//   write done                   -                   next answer
//
// outgoing_ holds answers that wait for the write under way. A newer frame replaces a waiting one,
// and a newer error a waiting one. So a slow client holds one message in the network and two here.
//
// The end: the client closes its side, cancels, or sends a wrong message, the server stops, the
// token is withdrawn, or the stream makes room for another caller's (CutOff). Then frames in work
// are cancelled, nothing new begins, and once neither frame nor write is under way the stream
// finishes. The call lives until OnDone, and as long as frames or alarms refer to it.

#include "server/interact/interact_service_impl.h"

#include <algorithm>
#include <cstdint>
#include <list>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "absl/container/flat_hash_set.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include <grpcpp/alarm.h>

#include "core/base/error_reason.h"
#include "core/base/log.h"
#include "core/base/memory_budget.h"
#include "core/base/retry_delay.h"
#include "core/base/status_macros.h"
#include "core/rpc/channel.h"
#include "core/rpc/grpc_status.h"
#include "core/rpc/known_fields.h"
#include "core/rpc/peer.h"
#include "core/rpc/proto_convert.h"
#include "core/rpc/request_context.h"
#include "core/rpc/write_timeout.h"
#include "server/frame/frame_call.h"
#include "server/interact/interact_frame.h"
#include "server/interact/interactive_schedule.h"
#include "server/interact/rate_control.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::v1;

constexpr double kMaxFramesPerSecond = 120;
// In which a client must take an answer.
constexpr absl::Duration kMaxWriteDuration = absl::Minutes(1);
// The same once the coordinator has ended the stream.
constexpr absl::Duration kMaxLastWriteDuration = absl::Seconds(2);
// After which one who met too many streams may try again: people close pages in minutes.
constexpr absl::Duration kFullDelay = absl::Seconds(5);
// The depth grid of an exact frame, which is warped when the view begins to move.
constexpr int kExactGridSide = 256;

absl::Status CheckState(const v1::ViewState& state, std::int64_t newest) {
  if (state.sequence_number() <= newest) {
    return absl::InvalidArgumentError(
        absl::StrCat("view_state.sequence_number is ", state.sequence_number(),
                     ": must be greater than that of the state before, ", newest));
  }
  const double rate = state.target_frames_per_second();
  if (rate != 0 && !(rate >= 1 && rate <= kMaxFramesPerSecond)) {
    return absl::InvalidArgumentError(absl::StrCat(
        "view_state.target_frames_per_second is ", rate, ": must lie in [1, ", kMaxFramesPerSecond,
        "], or be 0 for the default, ", RateControl::kDefaultFramesPerSecond));
  }
  return absl::OkStatus();
}

absl::Status CoordinatorStops() {
  return base::WithReason(absl::UnavailableError("the coordinator stops: connect again"),
                          base::ErrorReason::kServerStops);
}

void SetDepthGrid(const DepthGrid& grid, v1::DepthGrid* proto) {
  proto->set_width(grid.width);
  proto->set_height(grid.height);
  proto->set_near(grid.near_distance);
  proto->set_far(grid.far_distance);
  proto->set_depths(grid.depths);
}

}  // namespace

class InteractServiceImpl::InteractCall final
    : public grpc::ServerBidiReactor<v1::InteractRequest, v1::InteractResponse>,
      public std::enable_shared_from_this<InteractCall> {
 public:
  InteractCall(InteractServiceImpl* service, grpc::CallbackServerContext* context)
      : service_(service),
        origin_{.request = rpc::AnswerTraceContext(context),
                .client = context->peer(),
                .certificate = rpc::PeerOf(*context).name},
        deadline_(rpc::DeadlineOf(*context)),
        unsent_(&service->options_.runner->metrics()->unsent_bytes),
        timeout_(context) {}

  // Begins to read, or ends with the error of one of the two. REQUIRES: a shared_ptr owns the call.
  void Start(absl::StatusOr<Caller> caller) {
    self_ = shared_from_this();
    const absl::Status admitted = Admit(std::move(caller));
    if (admitted.ok()) {
      StartRead(&request_);
    } else {
      End(admitted);
    }
  }

  // Ends the stream although its client wants it, and waits little for what is on its way.
  void CutOff(CutReason reason, const absl::Status& status) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    if (end_.has_value()) {
      return;
    }
    service_->options_.runner->metrics()->CountCut(reason);
    EndLocked(status);
    if (is_writing_) {
      timeout_.Start(kMaxLastWriteDuration);
    }
    FinishIfIdle();
  }

  void OnReadDone(bool ok) override {
    if (!ok) {
      End(absl::OkStatus());
      return;
    }
    const absl::Status status = Handle(request_);
    if (!status.ok()) {
      End(status);
      return;
    }
    StartRead(&request_);
  }

  void OnWriteDone(bool ok) override {
    timeout_.Pause();
    const base::MutexLock lock(&mutex_);
    is_writing_ = false;
    unsent_.Set(0);
    in_flight_memory_.reset();
    if (!ok) {
      EndLocked(absl::CancelledError("the client has gone"));
    }
    WriteNext();
    FinishIfIdle();
  }

  void OnCancel() override { End(absl::CancelledError("the client cancelled the stream")); }

  void OnDone() override {
    timeout_.Stop();
    const std::shared_ptr<InteractCall> last_use = std::move(self_);
    service_->Remove(key_, last_use);
    const base::MutexLock lock(&mutex_);
    alarm_.reset();
    base::LogInfo("interact_done", {{"request", origin_.request.request_id()},
                                    {"states", newest_sequence_},
                                    {"frames", frame_count_},
                                    {"duration_ms", base::LogMilliseconds(absl::Now() - start_)}});
  }

  // Lets the frames in work stop, and ends the stream once they have. Only the first call counts.
  void End(const absl::Status& status) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    EndLocked(status);
    FinishIfIdle();
  }

 private:
  struct Answer {
    v1::InteractResponse message;
    bool is_frame = false;
    bool is_of_exact_work = false;
    // Of the message and of gRPC's copy, until it is written: slow clients must not add up to more
    // than the coordinator may have.
    std::optional<base::MemoryBudget::Reservation> memory = std::nullopt;
  };

  absl::Status Admit(absl::StatusOr<Caller> caller) {
    ISOSCOPE_RETURN_IF_ERROR(caller.status());
    caller_ = *std::move(caller);
    absl::StatusOr<CallerSlot> slot = caller_.Begin(CallerUse::kStream);
    ISOSCOPE_RETURN_IF_ERROR(
        service_->options_.runner->metrics()->CountRefusal(TokenLimit::kStreams, slot.status()));
    key_ = caller_.HostKey(origin_.client);
    ISOSCOPE_RETURN_IF_ERROR(service_->Add(key_, shared_from_this()));
    slot_.emplace(*std::move(slot));
    watch_.emplace(caller_.WhenWithdrawn([weak = weak_from_this()] {
      if (const std::shared_ptr<InteractCall> self = weak.lock()) {
        self->CutOff(CutReason::kTokenWithdrawn, WithdrawnError());
      }
    }));
    return absl::OkStatus();
  }

  absl::Status Handle(const v1::InteractRequest& request) ABSL_LOCKS_EXCLUDED(mutex_) {
    ISOSCOPE_RETURN_IF_ERROR(rpc::CheckKnownFields(request));
    ISOSCOPE_RETURN_IF_ERROR(service_->options_.access->CheckStillValid(caller_));
    const base::MutexLock lock(&mutex_);
    const absl::Time now = absl::Now();
    switch (request.kind_case()) {
      case v1::InteractRequest::kViewState: {
        ISOSCOPE_RETURN_IF_ERROR(CheckState(request.view_state(), newest_sequence_));
        state_ = request.view_state();
        newest_sequence_ = state_.sequence_number();
        rate_.SetTarget(state_.target_frames_per_second() > 0
                            ? state_.target_frames_per_second()
                            : RateControl::kDefaultFramesPerSecond);
        schedule_.OnState(newest_sequence_, state_.is_at_rest(), now);
        break;
      }
      case v1::InteractRequest::kFrameShown: {
        const v1::FrameShown& shown = request.frame_shown();
        const absl::Duration decode = rpc::DurationFromProto(shown.decode_duration());
        if (decode < absl::ZeroDuration()) {
          return absl::InvalidArgumentError(absl::StrCat("frame_shown.decode_duration is ",
                                                         absl::FormatDuration(decode),
                                                         ": must be at least 0"));
        }
        const std::optional<absl::Duration> delay = schedule_.OnShown(shown.frame_number(), now);
        const bool is_moving = moving_frames_.erase(shown.frame_number()) > 0;
        if (delay.has_value() && is_moving) {
          rate_.OnShown(*delay, decode, now);
          schedule_.SetCredits(rate_.credits());
        }
        break;
      }
      case v1::InteractRequest::KIND_NOT_SET:
        return absl::InvalidArgumentError(
            "kind is not set: a message needs view_state or frame_shown");
    }
    Proceed();
    return absl::OkStatus();
  }

  // Does what the schedule says.
  void Proceed() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    while (!end_.has_value()) {
      const absl::Time now = absl::Now();
      const InteractiveSchedule::Step step = schedule_.Next(now);
      for (const std::int64_t frame_number : step.overdue) {
        if (moving_frames_.contains(frame_number)) {
          rate_.OnOverdue(now);
        }
      }
      for (const std::int64_t work : step.cancel) {
        const auto it = frames_.find(work);
        if (it != frames_.end()) {
          it->second->Cancel();
        }
      }
      if (!step.start.has_value()) {
        WakeAt(step.wake);
        return;
      }
      Begin(*step.start);
    }
  }

  void Begin(const FrameStart& start) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const MovingQuality quality = rate_.quality();
    absl::Status admitted = CheckInteractiveOutput(state_);
    auto frame = std::make_shared<FrameCall>(
        service_->options_.runner, origin_,
        start.is_exact ? state_.frame() : MovingRequest(state_.frame(), quality), Delivery::kWhole,
        deadline_, service_->options_.max_frame_duration);
    frame->SetCaller(caller_, /*is_moving=*/!start.is_exact);
    frame->AskDepthGrid(start.is_exact ? kExactGridSide : quality.depth_grid_side);
    if (!start.is_exact) {
      frame->LogFailuresOnly();
    }
    if (admitted.ok()) {
      admitted = frame->Admit();
    }
    if (!admitted.ok()) {
      Audit(*frame, admitted);
      // The exact frame meets the same error, and tells it.
      bool is_told = start.is_exact || absl::IsInvalidArgument(admitted);
      if (absl::IsInvalidArgument(admitted)) {
        // A wrong state counts as a frame: it was worked on, and is answered.
        const absl::Status counted = service_->options_.runner->metrics()->CountRefusal(
            TokenLimit::kFrameRate, caller_.TakeFrame(/*is_moving=*/!start.is_exact));
        is_told = start.is_exact || counted.ok();
        admitted = counted.ok() ? admitted : counted;
      }
      schedule_.OnWorkEnded(start.work, is_told, absl::Now());
      if (is_told) {
        Answer answer;
        answer.message.set_sequence_number(start.sequence);
        answer.is_of_exact_work = start.is_exact;
        SetError(admitted, &answer.message);
        Send(std::move(answer));
      }
      return;
    }
    frames_[start.work] = frame;
    frame->Schedule([self = shared_from_this(), frame, start] { self->Draw(frame.get(), start); });
  }

  // On a frame thread.
  void Draw(FrameCall* frame, const FrameStart& start) ABSL_LOCKS_EXCLUDED(mutex_) {
    const absl::Time begin = absl::Now();
    absl::Time drawn = begin;
    frame->OnPictureDrawn([&] {
      drawn = absl::Now();
      const base::MutexLock lock(&mutex_);
      schedule_.OnDrawn(start.work);
      Proceed();
    });
    Answer answer;
    answer.message.set_sequence_number(start.sequence);
    const absl::Status status = frame->Render(answer.message.mutable_frame());
    frame->OnPictureDrawn(nullptr);
    const absl::Time end = absl::Now();
    answer.is_of_exact_work = start.is_exact;
    if (status.ok()) {
      answer.message.set_is_exact(start.is_exact);
      answer.is_frame = true;
      if (!start.is_exact) {
        // Nobody reads them, dozens of times a second.
        answer.message.mutable_frame()->mutable_statistics()->clear_agents();
      }
      if (frame->depth_grid().has_value()) {
        SetDepthGrid(*frame->depth_grid(), answer.message.mutable_depth_grid());
      }
    } else {
      SetError(status, &answer.message);
    }
    frame->ReleaseImages();
    if (auto memory = frame->TakeMemory(2 * answer.message.ByteSizeLong()); memory.has_value()) {
      answer.memory.emplace(*std::move(memory));
    }

    const base::MutexLock lock(&mutex_);
    Audit(*frame, status);
    frames_.erase(start.work);
    // A frame that was replaced is not missed. A moving one that fails is followed by an exact one
    // that does, too.
    const bool is_told = status.ok() || (start.is_exact && !absl::IsCancelled(status));
    schedule_.OnWorkEnded(start.work, is_told, end);
    if (status.ok() && !start.is_exact) {
      rate_.OnDrawn(drawn - begin, end);
    }
    if (is_told) {
      Send(std::move(answer));
    }
    Proceed();
    FinishIfIdle();
  }

  // Writes a line of the audit log for the first frame of a dataset, and whenever what comes of the
  // frames changes: dozens come a second.
  void Audit(const FrameCall& frame, const absl::Status& status)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    AuditLog* const log = service_->options_.runner->audit();
    if (log == nullptr || absl::IsCancelled(status)) {
      return;
    }
    AuditRecord record = frame.audit_record();
    if (audited_code_ == status.code() && record.dataset == audit_.dataset &&
        record.dataset_id == audit_.dataset_id) {
      return;
    }
    audit_ = std::move(record);
    audited_code_ = status.code();
    log->Write(NameOf(RequestMethod::kInteract), audit_, origin_.request.request_id(), status);
  }

  static void SetError(const absl::Status& status, v1::InteractResponse* message) {
    message->clear_frame();
    message->mutable_error()->set_code(static_cast<std::int32_t>(status.code()));
    message->mutable_error()->set_message(std::string(status.message()));
  }

  // Queues an answer. It replaces a waiting one of its kind, a frame or an error; a frame that is
  // older than what was sent is dropped.
  void Send(Answer answer) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (!answer.is_frame) {
      schedule_.OnError(absl::Now());
    }
    if (end_.has_value() ||
        (answer.is_frame && answer.message.sequence_number() < sent_sequence_)) {
      schedule_.OnDropped(answer.is_of_exact_work);
      return;
    }
    if (answer.is_frame) {
      sent_sequence_ = answer.message.sequence_number();
    }
    for (auto it = outgoing_.begin(); it != outgoing_.end();) {
      if (it->is_frame == answer.is_frame) {
        schedule_.OnDropped(it->is_of_exact_work);
        it = outgoing_.erase(it);
      } else {
        ++it;
      }
    }
    outgoing_.push_back(std::move(answer));
    WriteNext();
  }

  void WriteNext() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (is_writing_ || outgoing_.empty() || end_.has_value()) {
      return;
    }
    in_flight_ = std::move(outgoing_.front().message);
    in_flight_memory_.reset();
    if (outgoing_.front().memory.has_value()) {
      in_flight_memory_.emplace(*std::move(outgoing_.front().memory));
    }
    // The error of an exact frame waited as one, but needs no acknowledgement as one.
    const bool is_of_exact_work = outgoing_.front().is_of_exact_work;
    outgoing_.pop_front();
    in_flight_.set_frame_number(++frame_count_);
    if (in_flight_.has_frame() && !in_flight_.is_exact()) {
      // The client may leave frames unanswered.
      moving_frames_.insert(frame_count_);
      moving_frames_.erase(frame_count_ - 1000);
    }
    unsent_.Set(static_cast<std::int64_t>(in_flight_.ByteSizeLong()));
    schedule_.OnSent(frame_count_, absl::Now(), is_of_exact_work);
    if (in_flight_.has_error()) {
      schedule_.OnShown(frame_count_, absl::Now());  // there is nothing to show
    }
    is_writing_ = true;
    timeout_.Start(kMaxWriteDuration);
    StartWrite(&in_flight_);
  }

  void WakeAt(absl::Time time) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (time == absl::InfiniteFuture() || time >= alarm_time_) {
      return;  // an alarm that is too early asks again
    }
    alarm_time_ = time;
    alarm_ = std::make_unique<grpc::Alarm>();
    alarm_->Set(absl::ToChronoTime(time), [self = shared_from_this()](bool rang) {
      if (rang) {
        self->OnAlarm();
      }
    });
  }

  void OnAlarm() ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    if (absl::Now() >= alarm_time_) {
      alarm_time_ = absl::InfiniteFuture();
    }
    Proceed();
    FinishIfIdle();
  }

  void EndLocked(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (end_.has_value()) {
      return;
    }
    end_ = status;
    outgoing_.clear();
    for (const auto& [work, frame] : frames_) {
      frame->Cancel();
    }
  }

  void FinishIfIdle() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (end_.has_value() && frames_.empty() && !is_writing_ && !is_finished_) {
      is_finished_ = true;
      slot_.reset();  // before the client hears of the end, and opens another stream
      audit_.caller = caller_.name();
      audit_.certificate = origin_.certificate;
      audit_.peer = origin_.client;
      service_->options_.runner->EndRequest(RequestMethod::kInteract, audit_, origin_.request,
                                            *end_, absl::Now() - start_);
      Finish(rpc::ToGrpcStatus(*end_));
    }
  }

  InteractServiceImpl* const service_;
  const FrameOrigin origin_;  // of each frame of the stream
  const absl::Time deadline_;
  const absl::Time start_ = absl::Now();
  base::GaugeShare unsent_;  // of the write under way
  rpc::WriteTimeout timeout_;
  Caller caller_;    // set by Start
  std::string key_;  // among callers; empty: not added
  std::optional<CallerSlot> slot_;
  std::optional<WithdrawalWatch> watch_;
  v1::InteractRequest request_;  // of the read under way

  base::Mutex mutex_;
  v1::ViewState state_ ABSL_GUARDED_BY(mutex_);  // the newest
  std::int64_t newest_sequence_ ABSL_GUARDED_BY(mutex_) = 0;
  InteractiveSchedule schedule_ ABSL_GUARDED_BY(mutex_);
  RateControl rate_ ABSL_GUARDED_BY(mutex_);
  std::map<std::int64_t, std::shared_ptr<FrameCall>> frames_ ABSL_GUARDED_BY(mutex_);  // by work
  std::list<Answer> outgoing_ ABSL_GUARDED_BY(mutex_);
  v1::InteractResponse in_flight_ ABSL_GUARDED_BY(mutex_);
  std::optional<base::MemoryBudget::Reservation> in_flight_memory_ ABSL_GUARDED_BY(mutex_);
  bool is_writing_ ABSL_GUARDED_BY(mutex_) = false;
  std::int64_t frame_count_ ABSL_GUARDED_BY(mutex_) = 0;
  std::int64_t sent_sequence_ ABSL_GUARDED_BY(mutex_) = 0;
  absl::flat_hash_set<std::int64_t> moving_frames_ ABSL_GUARDED_BY(mutex_);  // not shown yet
  std::unique_ptr<grpc::Alarm> alarm_ ABSL_GUARDED_BY(mutex_);
  absl::Time alarm_time_ ABSL_GUARDED_BY(mutex_) = absl::InfiniteFuture();
  AuditRecord audit_ ABSL_GUARDED_BY(mutex_);  // of the last line
  std::optional<absl::StatusCode> audited_code_ ABSL_GUARDED_BY(mutex_);
  std::optional<absl::Status> end_ ABSL_GUARDED_BY(mutex_);
  bool is_finished_ ABSL_GUARDED_BY(mutex_) = false;
  std::shared_ptr<InteractCall> self_;  // reset by OnDone
};

InteractServiceImpl::InteractServiceImpl(const InteractServiceOptions& options)
    : options_(options) {
  rpc::PrepareKnownFields(v1::InteractRequest());
}

InteractServiceImpl::~InteractServiceImpl() = default;

grpc::ServerBidiReactor<v1::InteractRequest, v1::InteractResponse>* InteractServiceImpl::Interact(
    grpc::CallbackServerContext* context) {
  const auto call = std::make_shared<InteractCall>(this, context);
  call->Start(options_.access->Identify(rpc::PeerOf(*context)));
  return call.get();
}

void InteractServiceImpl::EndStreams() {
  std::vector<std::shared_ptr<InteractCall>> calls;
  {
    const base::MutexLock lock(&mutex_);
    is_stopping_ = true;
    for (const auto& [key, of_caller] : calls_) {
      calls.insert(calls.end(), of_caller.begin(), of_caller.end());
    }
  }
  for (const std::shared_ptr<InteractCall>& call : calls) {
    call->End(CoordinatorStops());
  }
}

absl::Status InteractServiceImpl::Add(const std::string& key,
                                      const std::shared_ptr<InteractCall>& call) {
  std::shared_ptr<InteractCall> evicted;
  {
    const base::MutexLock lock(&mutex_);
    if (is_stopping_) {
      return CoordinatorStops();
    }
    const auto own = calls_.find(key);
    const std::size_t own_count = own == calls_.end() ? 0 : own->second.size();
    if (call_count_ >= kMaxStreams) {
      const auto most = std::max_element(
          calls_.begin(), calls_.end(),
          [](const auto& a, const auto& b) { return a.second.size() < b.second.size(); });
      if (most->second.size() < own_count + 2) {
        return base::WithRetryDelay(absl::ResourceExhaustedError(absl::StrCat(
                                        kMaxStreams, " interactive streams are open, ", own_count,
                                        " of them of this caller: retry later, with back-off")),
                                    kFullDelay);
      }
      evicted = most->second.back();
      most->second.pop_back();
      --call_count_;
    }
    calls_[key].push_back(call);
    ++call_count_;
  }
  if (evicted != nullptr) {
    evicted->CutOff(CutReason::kMadeRoom,
                    base::WithRetryDelay(
                        absl::ResourceExhaustedError(absl::StrCat(
                            kMaxStreams,
                            " interactive streams are open, and this one made room for that of "
                            "another caller, which has fewer: retry later, with back-off")),
                        kFullDelay));
  }
  return absl::OkStatus();
}

void InteractServiceImpl::Remove(const std::string& key,
                                 const std::shared_ptr<InteractCall>& call) {
  const base::MutexLock lock(&mutex_);
  const auto of_caller = calls_.find(key);
  if (of_caller == calls_.end()) {
    return;
  }
  const auto it = std::find(of_caller->second.begin(), of_caller->second.end(), call);
  if (it == of_caller->second.end()) {
    return;  // it made room, or was not added
  }
  of_caller->second.erase(it);
  --call_count_;
  if (of_caller->second.empty()) {
    calls_.erase(of_caller);
  }
}

}  // namespace isoscope::server
