// Events of a stream come on gRPC's threads (a message, the end of a write, the alarm, a
// cancellation) and on frame threads (a frame has ended). Each takes mutex_, tells the schedule,
// and then calls Proceed, which executes the schedule's decision:
//
//   event                        tells               then
//   view state                   OnState             Proceed
//   frame shown                  OnShown, rate       Proceed
//   picture drawn                OnDrawn             Proceed
//   frame has ended              OnWorkEnded, rate   answer to outbox_, Proceed
//   step at rest has ended       OnWorkEnded, rest_  answer to outbox_, ContinueExact, Proceed
//   alarm                        -                   Proceed
//   write done                   -                   next answer
//
// A view that refines gets its exact frame in steps (rest_progress.h). Each is a work of the schedule
// with a ticket of its own; tiles share one PictureJob. A state with the same picture goes on with
// them. Another picture drops them: a step that ends later finds that picture_begin_ has changed.
//
// The stream ends when the client closes its side, cancels, or sends a wrong message. It also ends
// when the server stops, the token is withdrawn, or the stream makes room for another caller's
// (CutOff). Then frames in work are cancelled and no new ones begin. Once neither frame nor write
// is under way, the stream finishes. The call lives until OnDone, and as long as frames refer to it.
// The alarm and the watch of the token ring bells: their threads may outlive the service.

#include "server/interact/interact_service_impl.h"

#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include <grpcpp/alarm.h>

#include "core/base/log.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/frame/drawn_window.h"
#include "rpc/grpc_time.h"
#include "server/call/bell.h"
#include "server/call/public_call.h"
#include "server/frame/frame_ticket.h"
#include "server/frame/picture_job.h"
#include "server/interact/exact_cost.h"
#include "server/interact/interact_frame.h"
#include "server/interact/interact_outbox.h"
#include "server/interact/interactive_schedule.h"
#include "server/interact/rate_control.h"
#include "server/interact/rest_progress.h"
#include "wire/known_fields.h"
#include "wire/proto_convert.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::v1;

constexpr double kMaxFramesPerSecond = 120;
// A client must take an answer within this time.
constexpr absl::Duration kMaxWriteDuration = absl::Minutes(1);
// The same limit after the coordinator has ended the stream.
constexpr absl::Duration kMaxLastWriteDuration = absl::Seconds(2);
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

void SetDepthGrid(const DepthGrid& grid, v1::DepthGrid* proto) {
  proto->set_width(grid.width);
  proto->set_height(grid.height);
  proto->set_near(grid.near_distance);
  proto->set_far(grid.far_distance);
  proto->set_depths(grid.depths);
}

DrawnLevels LevelsOf(const FrameFacts& facts) {
  return {.drawn = facts.level, .asked = facts.asked_level, .coarsest = facts.coarsest_level};
}

// The end of a stream.
struct StreamEnd {
  absl::Status status;
  bool is_told = false;  // gRPC has it
};

// The last line of a stream in the audit log.
struct AuditedFrame {
  CallDataset dataset;
  std::optional<absl::StatusCode> code;  // none: there was no line
};

// The exact frame of a view that refines, on its way.
struct Rest {
  RestProgress progress{RestWish()};
  std::shared_ptr<PictureJob> job = nullptr;        // from the plan on
  absl::Duration drawn_for = absl::ZeroDuration();  // all tiles so far
  std::optional<v1::Camera> camera = std::nullopt;  // that the coarse frame told
};

// A step of it.
struct RestWork {
  FrameStart start;
  RestStep step;
  std::int64_t picture_begin = 0;
};

// The next alarm. An alarm that rings too early is set again.
struct Wake {
  base::MonotonicTime time = base::MonotonicTime::InfiniteFuture();
  std::unique_ptr<grpc::Alarm> alarm;
};

}  // namespace

// One stream.
class InteractServiceImpl::InteractCall final
    : public grpc::ServerBidiReactor<v1::InteractRequest, v1::InteractResponse>,
      public std::enable_shared_from_this<InteractCall> {
 public:
  InteractCall(const InteractServiceOptions& options, InteractStreams<InteractCall>* streams,
               grpc::CallbackServerContext* context)
      : options_(options),
        streams_(*streams),
        call_(&options.state->calls, RequestMethod::kInteract, context) {}

  // Begins to read, or ends with the error of admission. REQUIRES: a shared_ptr owns the call.
  void Start() {
    self_ = shared_from_this();
    alarm_.Hang([this] { OnAlarm(); });
    const absl::Status admitted = Admit();
    if (admitted.ok()) {
      StartRead(&request_);
    } else {
      End(admitted);
    }
  }

  void CutOff(CutReason reason, const absl::Status& status) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    if (end_.has_value()) {
      return;
    }
    call_.CountCut(reason);
    EndLocked(status);
    if (outbox_.is_writing()) {
      call_.timeout().Start(kMaxLastWriteDuration);
    }
    FinishIfIdle();
  }

  // Only the first call counts.
  void End(const absl::Status& status) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    EndLocked(status);
    FinishIfIdle();
  }

  void OnReadDone(bool ok) override {
    const absl::Status status = ok ? Handle(request_) : absl::OkStatus();
    if (ok && status.ok()) {
      StartRead(&request_);
    } else {
      End(status);
    }
  }

  void OnWriteDone(bool ok) override {
    call_.timeout().Pause();
    const base::MutexLock lock(&mutex_);
    call_.unsent().Set(0);
    outbox_.EndWrite();
    if (!ok) {
      EndLocked(absl::CancelledError("the client has gone"));
    }
    WriteNext();
    FinishIfIdle();
  }

  void OnCancel() override { End(absl::CancelledError("the client cancelled the stream")); }
  void OnDone() override {
    call_.timeout().Stop();
    alarm_.Silence();
    withdrawal_.Silence();
    const std::shared_ptr<InteractCall> last_use = std::move(self_);
    streams_.Remove(Key(), last_use);
    const base::MutexLock lock(&mutex_);
    wake_.alarm.reset();
    base::LogInfo("interact_done",
                  {{"request", call_.request().request_id()},
                   {"states", state_.sequence_number()},
                   {"frames", outbox_.sent_count()},
                   {"duration_ms", base::LogMilliseconds(base::MonotonicNow() - call_.arrival())}});
  }

 private:
  absl::Status Admit() {
    ISOSCOPE_RETURN_IF_ERROR(call_.Identify());
    ISOSCOPE_ASSIGN_OR_RETURN(CallerSlot slot, call_.caller().Begin(CallerUse::kStream));
    ISOSCOPE_RETURN_IF_ERROR(streams_.Add(Key(), shared_from_this()));
    slot_.emplace(std::move(slot));
    withdrawal_.Hang([this] { CutOff(CutReason::kTokenWithdrawn, WithdrawnError()); });
    watch_.emplace(call_.caller().WhenWithdrawn(withdrawal_.Rope()));
    return absl::OkStatus();
  }

  absl::Status Handle(const v1::InteractRequest& request) ABSL_LOCKS_EXCLUDED(mutex_) {
    ISOSCOPE_RETURN_IF_ERROR(wire::CheckKnownFields(request));
    ISOSCOPE_RETURN_IF_ERROR(options_.state->calls.access->CheckStillValid(call_.caller()));
    const base::MutexLock lock(&mutex_);
    switch (request.kind_case()) {
      case v1::InteractRequest::kViewState:
        ISOSCOPE_RETURN_IF_ERROR(HandleState(request.view_state(), base::MonotonicNow()));
        break;
      case v1::InteractRequest::kFrameShown:
        ISOSCOPE_RETURN_IF_ERROR(HandleShown(request.frame_shown(), base::MonotonicNow()));
        break;
      case v1::InteractRequest::KIND_NOT_SET:
        return absl::InvalidArgumentError(
            "kind is not set: a message needs view_state or frame_shown");
    }
    Proceed();
    return absl::OkStatus();
  }

  absl::Status HandleState(const v1::ViewState& state, base::MonotonicTime now)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    ISOSCOPE_RETURN_IF_ERROR(CheckState(state, state_.sequence_number()));
    ISOSCOPE_ASSIGN_OR_RETURN(const RestWish wish, RestWishFromProto(state.refinement()));
    const bool refines = state.has_refinement();
    std::string picture = refines ? state.frame().SerializeAsString() : std::string();
    const bool is_same = refines && state_.has_refinement() &&
                         (picture == picture_ || IsDeferredPicture(state.frame(), wish));
    if (state.frame().dataset() != state_.frame().dataset()) {
      rate_.ForgetLevels();
      cost_ = ExactCost();
    }
    state_ = state;
    picture_ = std::move(picture);
    rate_.AllowCoarseLevels(wish.coarse_levels);
    rate_.SetTarget(state.target_frames_per_second() > 0 ? state.target_frames_per_second()
                                                         : RateControl::kDefaultFramesPerSecond);
    if (is_same) {
      rest_.progress.SetWish(wish);
      schedule_.OnSamePicture(state.sequence_number(), state.is_at_rest());
      ContinueRest();
      return absl::OkStatus();
    }
    picture_begin_ = state.sequence_number();
    rest_ = Rest{.progress = RestProgress(wish)};
    outbox_.DropParts();
    schedule_.OnState(state.sequence_number(), state.is_at_rest(), now, refines);
    return absl::OkStatus();
  }

  // A client that let the server choose the camera asks for more of a picture that was put off: with
  // the camera that it was told. With the same limits it may have lost the picture, which begins anew.
  [[nodiscard]] bool IsDeferredPicture(const v1::RenderIsosurfaceRequest& frame,
                                       const RestWish& wish) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return rest_.camera.has_value() && rest_.progress.IsDeferredOtherwise(wish) &&
           HasToldCamera(state_.frame(), *rest_.camera, frame);
  }

  absl::Status HandleShown(const v1::FrameShown& shown, base::MonotonicTime now)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const absl::Duration decode = wire::DurationFromProto(shown.decode_duration());
    if (decode < absl::ZeroDuration()) {
      return absl::InvalidArgumentError(absl::StrCat(
          "frame_shown.decode_duration is ", absl::FormatDuration(decode), ": must be at least 0"));
    }
    const std::optional<absl::Duration> delay = schedule_.OnShown(shown.frame_number(), now);
    const bool is_moving = outbox_.NoteShown(shown.frame_number());
    if (delay.has_value() && is_moving) {
      rate_.OnShown(*delay, decode, now);
      schedule_.SetCredits(rate_.credits());
    }
    return absl::OkStatus();
  }

  // Executes the schedule's decision.
  void Proceed() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    while (!end_.has_value()) {
      const base::MonotonicTime now = base::MonotonicNow();
      const InteractiveSchedule::Step step = schedule_.Next(now);
      for (const std::int64_t frame_number : step.overdue) {
        if (outbox_.IsUnshownMoving(frame_number)) {
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

  // Agents elsewhere are known by the last frame.
  absl::StatusOr<AskedFrame> MovingFrameAtOnce(const v1::ViewState& state,
                                               const MovingQuality& quality) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const std::string& dataset_id = audited_.dataset.id.text();
    return MovingFrameOf(state, quality, [this, &dataset_id](const frame::FrameSpec& spec) {
      return IsDrawnAtOnce(dataset_id, spec);
    });
  }

  [[nodiscard]] bool IsDrawnAtOnce(const std::string& dataset_id,
                                   const frame::FrameSpec& spec) const {
    const std::size_t room = options_.runner->agent_room().MostPixels(
        dataset_id, frame::HasLayers(spec) ? spec.max_layers : 0);
    const view::Viewport drawn = frame::DrawnWindowOf(spec).image_size();
    if (room > 0 &&
        static_cast<std::size_t>(drawn.width_px) * static_cast<std::size_t>(drawn.height_px) >
            room) {
      return false;
    }
    const absl::StatusOr<BandGrid> bands =
        options_.state->memory.PlanFrame(spec, {.may_band = true}, {});
    return bands.ok() && bands->count() == 1;
  }

  void Begin(const FrameStart& start) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (start.is_exact && state_.has_refinement()) {
      BeginRest(start);
      return;
    }
    const MovingQuality quality = rate_.quality();
    const v1::ViewState& state = state_;
    absl::StatusOr<AskedFrame> asked =
        start.is_exact ? ExactFrameOf(state) : MovingFrameAtOnce(state, quality);
    auto ticket =
        std::make_shared<FrameTicket>(options_.state, call_.origin(),
                                      FrameClaim{.dataset = state.frame().dataset(),
                                                 .has_trace = state.frame().with_trace(),
                                                 .is_moving = !start.is_exact,
                                                 .client_deadline = call_.deadline(),
                                                 .max_duration = options_.max_frame_duration});
    using Job = absl::StatusOr<std::unique_ptr<PictureJob>>;
    Job job = asked.ok() ? PictureJob::Admit(
                               options_.runner, ticket, *std::move(asked),
                               start.is_exact ? kExactGridSide : quality.depth_grid_side,
                               state.has_refinement()
                                   ? std::optional(CoarserLevel{.least = quality.least_level})
                                   : std::nullopt)
                         : Job(asked.status());
    if (!job.ok()) {
      Audit(*ticket, job.status());
      Refuse(start, job.status());
      return;
    }
    frames_[start.work] = ticket;
    ticket->Schedule([self = shared_from_this(), ticket,
                      job = std::shared_ptr<PictureJob>(*std::move(job)),
                      start]() mutable { self->Draw(ticket.get(), std::move(job), start); });
  }

  // Answers a frame that got no place.
  void Refuse(const FrameStart& start, absl::Status status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    // The exact frame gets the same error, and reports it.
    bool is_told = start.is_exact || absl::IsInvalidArgument(status);
    if (absl::IsInvalidArgument(status)) {
      // A wrong state counts as a frame: the coordinator has worked on it and answers it.
      const absl::Status counted = call_.caller().TakeFrame(/*is_moving=*/!start.is_exact);
      is_told = start.is_exact || counted.ok();
      status = counted.ok() ? status : counted;
    }
    schedule_.OnWorkEnded(start.work, is_told, base::MonotonicNow());
    if (is_told) {
      InteractAnswer answer{.is_of_exact_work = start.is_exact};
      answer.message.set_sequence_number(SequenceOf(start));
      answer.SetError(status);
      Send(std::move(answer));
    }
  }

  // Runs on a frame thread.
  void Draw(FrameTicket* ticket, std::shared_ptr<PictureJob> job, const FrameStart& start)
      ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MonotonicTime begin = base::MonotonicNow();
    base::MonotonicTime drawn = begin;
    InteractAnswer answer{.is_of_exact_work = start.is_exact};
    answer.message.set_sequence_number(start.sequence);
    const absl::Status status = job->Run(answer.message.mutable_frame(), [&] {
      drawn = base::MonotonicNow();
      const base::MutexLock lock(&mutex_);
      schedule_.OnDrawn(start.work);
      Proceed();
    });
    const base::MonotonicTime end = base::MonotonicNow();
    if (status.ok()) {
      answer.message.set_is_exact(start.is_exact);
      if (!start.is_exact) {
        // Not worth their bytes, dozens of times a second.
        answer.message.mutable_frame()->mutable_statistics()->clear_agents();
      }
      if (job->depth_grid().has_value()) {
        SetDepthGrid(*job->depth_grid(), answer.message.mutable_depth_grid());
      }
    } else {
      answer.SetError(status);
    }
    const FrameFacts facts = job->facts();
    job.reset();  // the images go with it
    if (auto memory = ticket->ReleaseMemory(2 * answer.message.ByteSizeLong());
        memory.has_value()) {
      answer.memory.emplace(*std::move(memory));
    }

    const base::MutexLock lock(&mutex_);
    Audit(*ticket, status);
    frames_.erase(start.work);
    answer.message.set_sequence_number(SequenceOf(start));
    // A frame that was replaced needs no answer. A failed moving frame is followed by an exact one,
    // which fails too and reports it.
    const bool is_told = status.ok() || (start.is_exact && !absl::IsCancelled(status));
    schedule_.OnWorkEnded(start.work, is_told, end);
    if (status.ok() && !start.is_exact) {
      rate_.OnDrawn(drawn - begin, end, LevelsOf(facts));
      cost_.OnFrame(facts.active_bytes, end - begin, /*is_exact=*/false);
    }
    if (is_told) {
      Send(std::move(answer));
    }
    Proceed();
    FinishIfIdle();
  }

  // A frame of the picture that is wanted answers the newest state.
  [[nodiscard]] std::int64_t SequenceOf(const FrameStart& start) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return start.sequence >= picture_begin_ ? state_.sequence_number() : start.sequence;
  }

  // Begins the next step of a view at rest.
  void BeginRest(const FrameStart& start) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    RestWork work{
        .start = start, .step = rest_.progress.Next(cost_), .picture_begin = picture_begin_};
    if (work.step.kind == RestStep::Kind::kTile && rest_.job->tile_grid() == nullptr) {
      rest_.progress.OnTiles(
          rest_.job->BeginTiles(rest_.progress.TileSide(cost_)) ? rest_.job->tile_grid() : nullptr);
      work.step = rest_.progress.Next(cost_);
    }
    if (work.step.kind == RestStep::Kind::kNone) {
      schedule_.OnWorkEnded(start.work, /*has_answer=*/false, base::MonotonicNow());
    } else if (work.step.kind == RestStep::Kind::kDefer) {
      Defer(start);
    } else {
      ScheduleRest(work);
    }
  }

  void Defer(const FrameStart& start) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    rest_.progress.OnDeferred();
    schedule_.OnWorkEnded(start.work, /*has_answer=*/true, base::MonotonicNow());
    InteractAnswer answer{.is_of_exact_work = true, .is_part = true};
    answer.message.set_sequence_number(state_.sequence_number());
    *answer.message.mutable_exact_deferred() = rest_.progress.Deferral(cost_);
    Send(std::move(answer));
  }

  // Takes a place for the step.
  void ScheduleRest(const RestWork& work) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    using Kind = RestStep::Kind;
    const Kind kind = work.step.kind;
    auto ticket = std::make_shared<FrameTicket>(
        options_.state, call_.origin(),
        FrameClaim{.dataset = state_.frame().dataset(),
                   .is_moving = kind == Kind::kCoarse || kind == Kind::kTile,
                   .is_part = kind != Kind::kPlan && kind != Kind::kCoarse,
                   .client_deadline = call_.deadline(),
                   .max_duration = options_.max_frame_duration});
    absl::StatusOr<std::shared_ptr<PictureJob>> job = AdmitRest(work.step, ticket);
    if (!job.ok()) {
      Audit(*ticket, job.status());
      if (kind == Kind::kCoarse) {  // the exact frame reports it
        rest_.progress.OnCoarse(nullptr, /*tells_hidden=*/true);
        schedule_.OnWorkEnded(work.start.work, /*has_answer=*/false, base::MonotonicNow());
        schedule_.ContinueExact();
        return;
      }
      FailRest();
      Refuse(work.start, job.status());
      return;
    }
    frames_[work.start.work] = ticket;
    FrameTicket* const taken = ticket.get();
    taken->Schedule([self = shared_from_this(), ticket = std::move(ticket), job = *std::move(job),
                     work]() mutable { self->DrawRest(std::move(ticket), std::move(job), work); });
  }

  absl::StatusOr<std::shared_ptr<PictureJob>> AdmitRest(const RestStep& step,
                                                        const std::shared_ptr<FrameTicket>& ticket)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    using Kind = RestStep::Kind;
    if (step.kind == Kind::kTile || step.kind == Kind::kFinish) {
      ISOSCOPE_RETURN_IF_ERROR(ticket->TakePlace(
          step.kind == Kind::kTile ? rest_.job->SpecOfTile(step.tile) : rest_.job->spec(),
          /*may_band=*/true));
      return rest_.job;
    }
    ISOSCOPE_ASSIGN_OR_RETURN(AskedFrame asked,
                              step.kind == Kind::kCoarse
                                  ? MovingFrameAtOnce(state_, RestQualityOf(rate_.quality()))
                                  : ExactFrameOf(state_));
    if (step.stays) {  // what its level hides counts, then
      asked.with_unresolved_count = state_.frame().with_unresolved_count();
    }
    ISOSCOPE_ASSIGN_OR_RETURN(
        std::unique_ptr<PictureJob> job,
        PictureJob::Admit(options_.runner, ticket, std::move(asked), kExactGridSide,
                          CoarserLevel{.least = step.least_level}));
    return std::shared_ptr<PictureJob>(std::move(job));
  }

  // Runs on a frame thread.
  void DrawRest(std::shared_ptr<FrameTicket> ticket, std::shared_ptr<PictureJob> job,
                const RestWork& work) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MonotonicTime begin = base::MonotonicNow();
    const bool is_tile = work.step.kind == RestStep::Kind::kTile;
    InteractAnswer answer{.is_of_exact_work = true,
                          .is_part = is_tile || work.step.kind == RestStep::Kind::kCoarse};
    absl::Status status = RunRest(ticket, job.get(), work, &answer.message);
    const base::MonotonicTime end = base::MonotonicNow();
    if (!status.ok()) {
      answer.SetError(status);
    } else if (answer.message.has_frame() && job->depth_grid().has_value()) {
      SetDepthGrid(*job->depth_grid(), answer.message.mutable_depth_grid());
    }
    std::optional<base::MemoryBudget::Reservation> memory;
    {
      const base::MutexLock lock(&mutex_);
      Audit(*ticket, status);
      frames_.erase(work.start.work);
      NoteRest(work, status, end - begin, job, &answer.message);
    }
    job.reset();  // the images go with it, unless tiles follow
    if (auto released = ticket->ReleaseMemory(2 * answer.message.ByteSizeLong());
        released.has_value()) {
      answer.memory.emplace(*std::move(released));
    }

    const base::MutexLock lock(&mutex_);
    const bool is_current = work.picture_begin == picture_begin_;
    const bool is_told =
        is_current && !absl::IsCancelled(status) &&
        (answer.message.has_frame() || answer.message.has_tile() ||
         (answer.message.has_error() && work.step.kind != RestStep::Kind::kCoarse));
    answer.message.set_sequence_number(state_.sequence_number());
    schedule_.OnWorkEnded(work.start.work, is_told, end);
    if (is_current) {
      ContinueRest();
    }
    if (is_told) {
      Send(std::move(answer));
    }
    Proceed();
    FinishIfIdle();
  }

  absl::Status RunRest(const std::shared_ptr<FrameTicket>& ticket, PictureJob* job,
                       const RestWork& work, v1::InteractResponse* message)
      ABSL_LOCKS_EXCLUDED(mutex_) {
    using Kind = RestStep::Kind;
    const auto on_drawn = [&] {
      const base::MutexLock lock(&mutex_);
      schedule_.OnDrawn(work.start.work);
      Proceed();
    };
    switch (work.step.kind) {
      case Kind::kPlan: {
        v1::RenderIsosurfaceResponse frame;
        bool is_drawn = false;
        const auto begins = [&](const FrameFacts& facts) {
          const base::MutexLock lock(&mutex_);
          is_drawn = work.picture_begin == picture_begin_ && rest_.progress.OnFacts(facts, cost_);
          return is_drawn;
        };
        ISOSCOPE_RETURN_IF_ERROR(job->RunIf(begins, &frame, on_drawn));
        if (is_drawn) {
          *message->mutable_frame() = std::move(frame);
          message->set_is_exact(true);
        }
        return absl::OkStatus();
      }
      case Kind::kTile:
        return job->RunTile(ticket, work.step.tile, message->mutable_tile());
      case Kind::kFinish:
        message->set_is_exact(true);
        return job->FinishTiles(ticket, message->mutable_frame());
      default:
        message->set_is_exact(work.step.kind == Kind::kWhole);
        return job->Run(message->mutable_frame(), on_drawn);
    }
  }

  // Keeps what a step has made, and what it tells about the next ones.
  void NoteRest(const RestWork& work, const absl::Status& status, absl::Duration took,
                const std::shared_ptr<PictureJob>& job, v1::InteractResponse* message)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    using Kind = RestStep::Kind;
    if (work.picture_begin != picture_begin_ || absl::IsCancelled(status)) {
      return;
    }
    const Kind kind = work.step.kind;
    const FrameFacts& facts = job->facts();
    if (kind == Kind::kCoarse) {
      const v1::RenderIsosurfaceResponse& frame = message->frame();
      rest_.progress.OnCoarse(status.ok() ? &frame.drawn_level() : nullptr,
                              work.step.stays || !state_.frame().with_unresolved_count() ||
                                  frame.statistics().has_unresolved_block_count());
      if (status.ok()) {
        rest_.camera = frame.camera();
        message->mutable_frame()->mutable_statistics()->clear_agents();
        cost_.OnFrame(facts.active_bytes, took, /*is_exact=*/false);
      }
      return;
    }
    if (!status.ok()) {
      FailRest();
      return;
    }
    if (kind == Kind::kTile) {
      message->mutable_tile()->set_index(rest_.progress.drawn_tile_count());
      rest_.progress.OnTileDrawn(work.step.tile);
      rest_.drawn_for += took;
    } else if (kind == Kind::kPlan && !message->has_frame()) {
      rest_.job = job;
    } else {
      rest_.progress.OnExact();
      cost_.OnFrame(facts.active_bytes, rest_.drawn_for + took, /*is_exact=*/true);
      rest_.job.reset();
    }
  }

  void FailRest() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    rest_.progress.OnError();
    rest_.job.reset();
    rest_.drawn_for = absl::ZeroDuration();
  }

  // Lets the schedule begin the next step, if there is one.
  void ContinueRest() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (rest_.progress.Next(cost_).kind != RestStep::Kind::kNone) {
      schedule_.ContinueExact();
    }
  }

  // Writes a line of the audit log for the first frame of a dataset, and whenever the status of the
  // frames changes: dozens come a second.
  void Audit(const FrameTicket& ticket, const absl::Status& status)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (absl::IsCancelled(status) ||
        (audited_.code == status.code() && audited_.dataset == ticket.dataset())) {
      return;
    }
    audited_ = {.dataset = ticket.dataset(), .code = status.code()};
    call_.NoteDataset(ticket.dataset());
    call_.Audit(status);
  }

  void Send(InteractAnswer answer) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    outbox_.Push(std::move(answer), base::MonotonicNow());
    WriteNext();
  }

  void WriteNext() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const v1::InteractResponse* const message = outbox_.BeginWrite(base::MonotonicNow());
    if (message == nullptr) {
      return;
    }
    call_.unsent().Set(static_cast<std::int64_t>(message->ByteSizeLong()));
    call_.timeout().Start(kMaxWriteDuration);
    StartWrite(message);
  }

  void WakeAt(base::MonotonicTime time) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (time == base::MonotonicTime::InfiniteFuture() || time >= wake_.time) {
      return;
    }
    wake_ = {.time = time, .alarm = std::make_unique<grpc::Alarm>()};
    wake_.alarm->Set(time, [rope = alarm_.Rope()](bool rang) {
      if (rang) {
        rope();
      }
    });
  }

  void OnAlarm() ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    if (base::MonotonicNow() >= wake_.time) {
      wake_.time = base::MonotonicTime::InfiniteFuture();
    }
    Proceed();
    FinishIfIdle();
  }

  void EndLocked(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (end_.has_value()) {
      return;
    }
    end_ = StreamEnd{.status = status};
    outbox_.Close();
    picture_begin_ = std::numeric_limits<std::int64_t>::max();  // no picture is wanted
    rest_ = Rest();
    for (const auto& [work, frame] : frames_) {
      frame->Cancel();
    }
  }

  void FinishIfIdle() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (!end_.has_value() || !frames_.empty() || outbox_.is_writing() || end_->is_told) {
      return;
    }
    end_->is_told = true;
    slot_.reset();  // before the client receives the end, and may open another stream
    Finish(call_.End(end_->status));
  }

  [[nodiscard]] std::string Key() const { return call_.caller().HostKey(call_.origin().client); }

  const InteractServiceOptions options_;
  InteractStreams<InteractCall>& streams_;
  PublicCall call_;
  std::optional<CallerSlot> slot_;
  Bell alarm_;  // both ring without mutex_
  Bell withdrawal_;
  std::optional<WithdrawalWatch> watch_;
  v1::InteractRequest request_;  // of the read under way

  base::Mutex mutex_;
  v1::ViewState state_ ABSL_GUARDED_BY(mutex_);             // the newest
  std::string picture_ ABSL_GUARDED_BY(mutex_);             // bytes of its frame, if it refines
  std::int64_t picture_begin_ ABSL_GUARDED_BY(mutex_) = 0;  // the first state with this picture
  Rest rest_ ABSL_GUARDED_BY(mutex_);
  ExactCost cost_ ABSL_GUARDED_BY(mutex_);
  InteractiveSchedule schedule_ ABSL_GUARDED_BY(mutex_);
  RateControl rate_ ABSL_GUARDED_BY(mutex_);
  std::map<std::int64_t, std::shared_ptr<FrameTicket>> frames_ ABSL_GUARDED_BY(mutex_);  // by work
  InteractOutbox outbox_ ABSL_GUARDED_BY(mutex_){&schedule_};
  Wake wake_ ABSL_GUARDED_BY(mutex_);
  AuditedFrame audited_ ABSL_GUARDED_BY(mutex_);
  std::optional<StreamEnd> end_ ABSL_GUARDED_BY(mutex_);
  std::shared_ptr<InteractCall> self_;  // reset by OnDone
};

InteractServiceImpl::InteractServiceImpl(const InteractServiceOptions& options)
    : options_(options) {
  wire::PrepareKnownFields(v1::InteractRequest());
}

InteractServiceImpl::~InteractServiceImpl() = default;

grpc::ServerBidiReactor<v1::InteractRequest, v1::InteractResponse>* InteractServiceImpl::Interact(
    grpc::CallbackServerContext* context) {
  const auto call = std::make_shared<InteractCall>(options_, &streams_, context);
  call->Start();
  return call.get();
}

void InteractServiceImpl::EndStreams() { streams_.EndAll(); }

}  // namespace isoscope::server
