#include "server/call/call_work.h"

#include <utility>

#include "core/base/status_macros.h"

namespace isoscope::server {

absl::Status CallWork::TakeUse(const Caller& caller, CallerUse use) {
  caller_ = caller;
  ISOSCOPE_RETURN_IF_ERROR(caller_.CheckBytes());
  ISOSCOPE_ASSIGN_OR_RETURN(CallerSlot slot, caller_.Begin(use));
  use_.emplace(std::move(slot));
  return absl::OkStatus();
}

absl::Status CallWork::TakeRate(bool is_moving) {
  absl::Status taken = caller_.TakeFrame(is_moving);
  has_rate_ = taken.ok();
  if (!taken.ok()) {
    use_.reset();
  }
  return taken;
}

void CallWork::ReturnShare() {
  if (std::exchange(has_rate_, false)) {
    caller_.ReturnFrame();
  }
  use_.reset();
}

absl::Status CallWork::TakePlace(const std::string& client) {
  absl::StatusOr<Admission::Place> place = queue_.Admit(client);
  if (!place.ok()) {
    ReturnShare();
    return place.status();
  }
  ticket_.store(place->ticket());
  place_.emplace(*std::move(place));
  return absl::OkStatus();
}

void CallWork::Schedule(Admission::Work work) {
  queue_.Schedule(ticket_.load(), cancellation_.deadline(),
                  [this, work = std::move(work)](const absl::Status& turn) {
                    if (std::exchange(has_rate_, false) && absl::IsResourceExhausted(turn)) {
                      caller_.ReturnFrame();
                    }
                    work(turn);
                  });
  if (cancellation_.is_cancelled()) {  // cancelled before Leave had a ticket
    queue_.Leave(ticket_.load());
  }
}

void CallWork::Cancel() {
  cancellation_.Cancel();
  queue_.Leave(ticket_.load());
}

absl::Status CallWork::KeepMemory(absl::StatusOr<base::MemoryBudget::Reservation> memory) {
  ISOSCOPE_RETURN_IF_ERROR(memory.status());
  memory_.emplace(*std::move(memory));
  return absl::OkStatus();
}

void CallWork::ShrinkMemory(std::size_t bytes) {
  if (memory_.has_value()) {
    memory_->ShrinkTo(bytes);
  }
}

std::optional<base::MemoryBudget::Reservation> CallWork::ReleaseMemory(std::size_t bytes) {
  ShrinkMemory(bytes);
  std::optional<base::MemoryBudget::Reservation> released = std::move(memory_);
  memory_.reset();
  return released;
}

}  // namespace isoscope::server
