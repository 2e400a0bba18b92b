#include "server/frame/frame_ticket.h"

#include <algorithm>
#include <string>
#include <utility>

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

FrameTicket::FrameTicket(CoordinatorState* state, const CallOrigin& origin, const FrameClaim& claim)
    : state_(*state),
      origin_(origin),
      claim_(claim),
      work_(&state->frames, EndOf(claim)),
      dataset_{.name = claim.dataset} {}

absl::Status FrameTicket::TakePlace(const frame::FrameSpec& spec, bool may_band) {
  may_band_ = may_band;
  absl::Status status = TakePlaceUncounted(spec);
  if (absl::IsResourceExhausted(status)) {
    state_.frame_metrics.CountRefused(origin_.caller.name());
  }
  return status;
}

absl::Status FrameTicket::TakePlaceUncounted(const frame::FrameSpec& spec) {
  FrameMetrics& metrics = state_.frame_metrics;
  const Caller& caller = origin_.caller;
  ISOSCOPE_RETURN_IF_ERROR(CheckAnswerBytes(RawResponseBytes(spec)));
  ISOSCOPE_RETURN_IF_ERROR(caller.CheckViewport(spec.viewport.width_px, spec.viewport.height_px));
  ISOSCOPE_RETURN_IF_ERROR(work_.TakeUse(caller, CallerUse::kFrame));
  if (!claim_.is_part) {
    if (absl::Status rate = work_.TakeRate(claim_.is_moving); !rate.ok()) {
      metrics.rate_limited.Add();
      return rate;
    }
  }
  if (absl::Status fits = state_.memory.CheckFits(spec, wish()); !fits.ok()) {
    metrics.too_large.Add();
    work_.ReturnShare();
    return fits;
  }
  if (absl::Status placed = work_.TakePlace(caller.QueueKey(origin_.client)); !placed.ok()) {
    metrics.refused.Add();
    return placed;
  }
  const view::Viewport size = frame::ImageSizeOf(spec);
  on_board_.emplace(state_.board.Add({.request_id = origin_.request.request_id(),
                                      .client = origin_.client,
                                      .dataset = claim_.dataset,
                                      .width_px = size.width_px,
                                      .height_px = size.height_px,
                                      .arrival = start_}));
  return absl::OkStatus();
}

void FrameTicket::Schedule(std::function<void()> work) {
  work_.Schedule([this, work = std::move(work)](const absl::Status& turn) {
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
  state_.frame_metrics.queue_wait.Observe(base::MonotonicNow() - start_);
  frame_number_ = state_.next_frame_number.fetch_add(1);
}

absl::Status FrameTicket::TakeMemory(const frame::FrameSpec& spec) {
  const base::ScopedObservation wait(&state_.frame_metrics.memory_wait);
  return work_.KeepMemory(state_.memory.ReserveFrame(spec, wish(), cancellation()));
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
  state_.frame_metrics.response_bytes.Add(static_cast<std::int64_t>(bytes));
  origin_.caller.CountBytes(bytes);
}

void FrameTicket::KeepMemoryOfAnswer(std::size_t answer_bytes) {
  // gRPC copies a whole answer; of an answer in parts it copies only a few parts.
  work_.ShrinkMemory(answer_bytes +
                     (claim_.delivery == Delivery::kWhole ? answer_bytes : kPartsUnderWayBytes));
}

void FrameTicket::NoteDataset(const v1::Dataset& dataset) {
  dataset_ = {.name = dataset.name(), .id = dataset.dataset_id()};
}

void FrameTicket::EndWork(const frame::FrameSpec& spec, const absl::Status& status,
                          const FrameCost& cost) {
  if (!is_put_off_ || !status.ok()) {
    Log(spec, status, cost);
    CountEnd(status);
    if (status.ok()) {
      state_.frame_metrics.CountSteps(cost);
    }
  }
  on_board_.reset();
  // The client gets its answer later, so that its next request finds a free place and share.
  work_.GiveBackPlace();
  work_.GiveBackShare();
}

void FrameTicket::CountEnd(const absl::Status& status) const {
  FrameMetrics& metrics = state_.frame_metrics;
  const std::string caller = origin_.caller.name();
  if (absl::IsResourceExhausted(lost_turn_)) {
    metrics.refused.Add();
    metrics.displaced.Add();
    metrics.CountRefused(caller);
    return;
  }
  if (absl::IsDeadlineExceeded(lost_turn_)) {
    metrics.expired.Add();
  }
  metrics.CountEnd(status, base::MonotonicNow() - start_, claim_.is_moving, caller);
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
                   {"dataset", dataset_.name},
                   {"surfaces", frame::TextOf(frame::RulesOf(spec))},
                   {"width", frame::ImageSizeOf(spec).width_px},
                   {"height", frame::ImageSizeOf(spec).height_px},
                   {"duration_ms", duration},
                   {"bands", cost.band_count},
                   {"triangles", cost.total.triangle_count},
                   {"agents", cost.agents.size()},
                   {"network_bytes", cost.network_bytes},
                   {"caller", origin_.caller.name()},
                   {"peer", origin_.client}});
  }
}

}  // namespace isoscope::server
