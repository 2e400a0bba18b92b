#include "server/frame/frame_ticket.h"

#include <algorithm>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"

#include "core/base/log.h"
#include "core/base/monotonic_time.h"
#include "core/base/no_memory.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "rpc/channel.h"

namespace isoscope::server {
namespace {

// Bytes reserved in a message for all fields but picture and planes.
constexpr std::size_t kOtherFieldsBytes = base::kMiB;

// The bytes of an answer in parts that are copied to be sent.
constexpr std::size_t kPartsUnderWayBytes = 2 * base::kMiB;

// Returns when a frame that begins now must end, so that its client still receives the name of a
// late agent. If the client's own deadline passed first, it would not.
base::MonotonicTime EndOf(const FrameClaim& claim) {
  constexpr absl::Duration kMaxMargin = absl::Milliseconds(200);  // an answer on a slow network
  constexpr int kMarginShare = 10;                                // of the client's time
  const base::MonotonicTime now = base::MonotonicNow();
  const absl::Duration margin = std::min((claim.client_deadline - now) / kMarginShare, kMaxMargin);
  return std::min(claim.client_deadline - std::max(margin, absl::ZeroDuration()),
                  now + claim.max_duration);
}

std::size_t RawResponseBytes(const frame::FrameSpec& spec) {
  const view::Viewport size = frame::ImageSizeOf(spec);
  return static_cast<std::size_t>(size.width_px) * static_cast<std::size_t>(size.height_px) *
         frame::RawBytesPerPixel(spec.output);
}

}  // namespace

FrameTicket::FrameTicket(FrameRunner* runner, const FrameOrigin& origin, const FrameClaim& claim)
    : runner_(*runner), origin_(origin), claim_(claim), turn_(runner->admission(), EndOf(claim)) {}

absl::Status FrameTicket::TakePlace(const frame::FrameSpec& spec) {
  absl::Status status = TakePlaceUncounted(spec);
  if (absl::IsResourceExhausted(status)) {
    runner_.metrics()->CountRefused(origin_.caller.name());
  }
  return status;
}

absl::Status FrameTicket::TakePlaceUncounted(const frame::FrameSpec& spec) {
  ISOSCOPE_RETURN_IF_ERROR(CheckAnswerBytes(RawResponseBytes(spec)));
  const Caller& caller = origin_.caller;
  ISOSCOPE_RETURN_IF_ERROR(caller.CheckViewport(spec.viewport.width_px, spec.viewport.height_px));
  ISOSCOPE_RETURN_IF_ERROR(TakeShare());
  absl::Status placed = turn_.Keep(
      runner_.Admit(caller.QueueKey(origin_.client), spec, claim_.delivery, claim_.has_trace));
  if (!placed.ok()) {
    caller.ReturnFrame();
    slot_.reset();
    return placed;
  }
  const view::Viewport size = frame::ImageSizeOf(spec);
  on_board_.emplace(runner_.board()->Add({.request_id = origin_.request.request_id(),
                                          .client = origin_.client,
                                          .dataset = claim_.dataset,
                                          .width_px = size.width_px,
                                          .height_px = size.height_px,
                                          .arrival = start_}));
  return absl::OkStatus();
}

absl::Status FrameTicket::TakeShare() {
  CoordinatorMetrics* const metrics = runner_.metrics();
  const Caller& caller = origin_.caller;
  ISOSCOPE_RETURN_IF_ERROR(metrics->CountRefusal(TokenLimit::kBytes, caller.CheckBytes()));
  absl::StatusOr<CallerSlot> slot = caller.Begin(CallerUse::kFrame);
  ISOSCOPE_RETURN_IF_ERROR(metrics->CountRefusal(TokenLimit::kFrames, slot.status()));
  absl::Status rate =
      metrics->CountRefusal(TokenLimit::kFrameRate, caller.TakeFrame(claim_.is_moving));
  if (!rate.ok()) {
    metrics->frames.rate_limited.Add();
    return rate;
  }
  slot_.emplace(*std::move(slot));
  return absl::OkStatus();
}

void FrameTicket::Schedule(std::function<void()> work) {
  turn_.Schedule([this, work = std::move(work)](const absl::Status& turn) {
    lost_turn_ = turn;
    work();
  });
}

absl::Status FrameTicket::Run(const frame::FrameSpec& spec, const FrameCost& cost,
                              absl::FunctionRef<absl::Status()> work) {
  BeginWork();
  absl::Status status = base::OrNoMemory(absl::StrCat("the ", claim_.noun),
                                         [&] { return lost_turn_.ok() ? work() : lost_turn_; });
  EndWork(spec, status, cost);
  return status;
}

void FrameTicket::BeginWork() {
  on_board_->phase()->store(FramePhase::kPreparing, std::memory_order_relaxed);
  runner_.metrics()->durations.queue_wait.Observe(base::MonotonicNow() - start_);
  frame_number_ = runner_.NextFrameNumber();
}

absl::StatusOr<FrameTarget> FrameTicket::Prepare(AskedFrame* asked, base::TraceRecorder* trace) {
  {
    const base::TraceScope scope(trace, "memory");
    const base::MonotonicTime start = base::MonotonicNow();
    const absl::Cleanup count = [&] {
      runner_.metrics()->durations.memory_wait.Observe(base::MonotonicNow() - start);
    };
    ISOSCOPE_ASSIGN_OR_RETURN(
        base::MemoryBudget::Reservation memory,
        runner_.ReserveMemory(asked->spec, claim_.delivery, claim_.has_trace, cancellation()));
    memory_.emplace(std::move(memory));
  }
  const base::TraceScope scope(trace, "find dataset");
  absl::StatusOr<FrameTarget> target = runner_.FindTarget(Identity(), asked);
  if (target.ok()) {
    dataset_name_ = target->dataset->dataset.name();
    dataset_id_ = target->dataset->dataset.dataset_id();
  }
  return target;
}

FrameIdentity FrameTicket::Identity() const {
  return {.number = frame_number_,
          .request = &origin_.request,
          .caller = &origin_.caller,
          .cancellation = &cancellation(),
          .phase = on_board_->phase()};
}

absl::Status FrameTicket::CheckAnswerBytes(std::size_t bytes) const {
  if (claim_.delivery == Delivery::kParts ||
      bytes + kOtherFieldsBytes <= static_cast<std::size_t>(rpc::kMaxMessageBytes)) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(absl::StrCat(
      "output: picture and planes have ", bytes, " bytes and one message holds at most ",
      rpc::kMaxMessageBytes, ": ask RenderIsosurfaceStream, or for a region or fewer planes"));
}

void FrameTicket::CountAnswer(std::size_t bytes) const {
  runner_.metrics()->response_bytes.Add(static_cast<std::int64_t>(bytes));
  origin_.caller.CountBytes(bytes);
}

void FrameTicket::KeepMemoryOfAnswer(std::size_t answer_bytes) {
  if (memory_.has_value()) {
    // gRPC copies a whole answer; of an answer in parts it copies only a few parts.
    memory_->ShrinkTo(answer_bytes +
                      (claim_.delivery == Delivery::kWhole ? answer_bytes : kPartsUnderWayBytes));
  }
}

std::optional<base::MemoryBudget::Reservation> FrameTicket::TakeMemory(std::size_t bytes) {
  if (memory_.has_value()) {
    memory_->ShrinkTo(bytes);
  }
  std::optional<base::MemoryBudget::Reservation> taken = std::move(memory_);
  memory_.reset();
  return taken;
}

AuditRecord FrameTicket::audit_record() const {
  return {.caller = origin_.caller.name(),
          .certificate = origin_.certificate,
          .peer = origin_.client,
          .dataset = dataset_name_.empty() ? claim_.dataset : base::ForeignText(dataset_name_),
          .dataset_id = dataset_id_};
}

void FrameTicket::EndRequest(RequestMethod method, const absl::Status& status) const {
  runner_.EndRequest(method, audit_record(), origin_.request, status,
                     base::MonotonicNow() - start_);
}

void FrameTicket::EndWork(const frame::FrameSpec& spec, const absl::Status& status,
                          const FrameCost& cost) {
  Log(spec, status, cost);
  CountEnd(status);
  if (status.ok()) {
    CountSteps(cost);
  }
  on_board_.reset();
  // Before the client gets its answer, so that its next request finds a free place and share.
  turn_.GiveBack();
  slot_.reset();
}

void FrameTicket::CountEnd(const absl::Status& status) const {
  CoordinatorMetrics* const metrics = runner_.metrics();
  const Caller& caller = origin_.caller;
  if (absl::IsResourceExhausted(lost_turn_)) {
    metrics->frames.refused.Add();
    metrics->frames.displaced.Add();
    caller.ReturnFrame();
    metrics->CountRefused(caller.name());
    return;
  }
  if (absl::IsDeadlineExceeded(lost_turn_)) {
    metrics->frames.expired.Add();
  }
  metrics->CountFrame(status, base::MonotonicNow() - start_, claim_.is_moving, caller.name());
}

void FrameTicket::CountSteps(const FrameCost& cost) const {
  CoordinatorMetrics* const metrics = runner_.metrics();
  metrics->durations.occluder_selection.Observe(cost.occluder_selection);
  metrics->durations.occluder_rendering.Observe(cost.occluder_rendering);
  metrics->durations.visibility_culling.Observe(cost.visibility_culling);
  metrics->durations.composite.Observe(cost.composite);
  metrics->durations.encode.Observe(cost.encode.value_or(absl::ZeroDuration()));
  metrics->network_bytes.Add(cost.network_bytes);
}

void FrameTicket::Log(const frame::FrameSpec& spec, const absl::Status& status,
                      const FrameCost& cost) const {
  const std::string duration = base::LogMilliseconds(base::MonotonicNow() - start_);
  if (!status.ok()) {
    // Moving views cancel frames all the time.
    const base::LogLevel level = !absl::IsCancelled(status) ? base::LogLevel::kWarning
                                 : claim_.is_moving         ? base::LogLevel::kDebug
                                                            : base::LogLevel::kInfo;
    base::Log(level,
              absl::StrCat(claim_.noun, absl::IsCancelled(status) ? "_cancelled" : "_failed"),
              {{"request", origin_.request.request_id()},
               {"frame", frame_number_},
               {"dataset", claim_.dataset},
               {"duration_ms", duration},
               {"caller", origin_.caller.name()},
               {"peer", origin_.client},
               {"status", status}});
  } else if (!claim_.is_moving) {
    base::LogInfo(absl::StrCat(claim_.noun, "_done"),
                  {{"request", origin_.request.request_id()},
                   {"frame", frame_number_},
                   {"dataset", dataset_name_},
                   {"surfaces", frame::TextOf(frame::RulesOf(spec))},
                   {"width", frame::ImageSizeOf(spec).width_px},
                   {"height", frame::ImageSizeOf(spec).height_px},
                   {"duration_ms", duration},
                   {"triangles", cost.total.triangle_count},
                   {"agents", cost.agents.size()},
                   {"network_bytes", cost.network_bytes},
                   {"caller", origin_.caller.name()},
                   {"peer", origin_.client}});
  }
}

}  // namespace isoscope::server
