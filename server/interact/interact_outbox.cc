#include "server/interact/interact_outbox.h"

#include <optional>
#include <string>
#include <utility>

#include "absl/time/time.h"

#include "core/base/error_reason.h"
#include "core/base/monotonic_time.h"
#include "core/base/retry_delay.h"
#include "rpc/grpc_status.h"
#include "wire/proto_convert.h"

namespace isoscope::server {

namespace v1 = isoscope::v1;
namespace {

enum class AnswerKind { kFrame, kTile, kError, kDeferral };

AnswerKind KindOf(const v1::InteractResponse& message) {
  if (message.has_tile()) {
    return AnswerKind::kTile;
  }
  if (message.has_exact_deferred()) {
    return AnswerKind::kDeferral;
  }
  return message.has_frame() ? AnswerKind::kFrame : AnswerKind::kError;
}

}  // namespace

void InteractAnswer::SetError(const absl::Status& status) {
  message.clear_frame();
  message.clear_tile();
  v1::FrameError& error = *message.mutable_error();
  error.set_code(static_cast<std::int32_t>(status.code()));
  error.set_message(rpc::BoundedMessage(status.message()));
  error.set_reason(base::NameOf(base::ReasonOf(status)));
  if (const std::optional<absl::Duration> delay = base::RetryDelayOf(status)) {
    *error.mutable_retry_duration() = wire::ToProto(*delay);
  }
}

void InteractOutbox::Push(InteractAnswer answer, base::MonotonicTime now) {
  const AnswerKind kind = KindOf(answer.message);
  const bool shows = kind == AnswerKind::kFrame || kind == AnswerKind::kTile;
  const std::int64_t sequence = answer.message.sequence_number();
  if (kind == AnswerKind::kError) {
    schedule_.OnError(now);
  }
  if (is_closed_ || (shows && sequence < newest_sequence_)) {
    schedule_.OnDropped(answer.is_of_exact_work);
    return;
  }
  if (shows) {
    newest_sequence_ = sequence;
  }
  waiting_.remove_if([&](const InteractAnswer& older) {
    const bool is_replaced = kind != AnswerKind::kTile && KindOf(older.message) == kind;
    if (is_replaced) {
      schedule_.OnDropped(older.is_of_exact_work);
    }
    return is_replaced;
  });
  waiting_.push_back(std::move(answer));
}

const v1::InteractResponse* InteractOutbox::BeginWrite(base::MonotonicTime now) {
  if (is_writing_ || waiting_.empty()) {
    return nullptr;
  }
  is_writing_ = true;
  in_flight_.message = std::move(waiting_.front().message);
  in_flight_.memory.reset();
  if (waiting_.front().memory.has_value()) {
    in_flight_.memory.emplace(*std::move(waiting_.front().memory));
  }
  // The error of an exact frame waited as an exact answer, but needs no acknowledgement as one.
  const bool is_of_exact_work = waiting_.front().is_of_exact_work;
  schedule_.OnSent(++sent_count_, now, is_of_exact_work, waiting_.front().is_part);
  waiting_.pop_front();
  v1::InteractResponse& message = in_flight_.message;
  message.set_frame_number(sent_count_);
  if (message.has_error() || message.has_exact_deferred()) {
    schedule_.OnShown(sent_count_, now);  // the client shows nothing for it
  } else if (!is_of_exact_work) {
    constexpr std::int64_t kMaxUnshown = 1000;  // the client may never acknowledge frames
    moving_.insert(sent_count_);
    moving_.erase(sent_count_ - kMaxUnshown);
  }
  return &message;
}

void InteractOutbox::EndWrite() {
  is_writing_ = false;
  in_flight_.memory.reset();
}

void InteractOutbox::DropParts() {
  waiting_.remove_if([&](const InteractAnswer& answer) {
    if (answer.is_part) {
      schedule_.OnDropped(answer.is_of_exact_work);
    }
    return answer.is_part;
  });
}

void InteractOutbox::Close() {
  is_closed_ = true;
  waiting_.clear();
}

}  // namespace isoscope::server
