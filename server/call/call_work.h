// A piece of work of a call: a frame, a pick, an export, a histogram. It takes the stages from
// share to memory (public_call.h), and holds what they give.

#ifndef ISOSCOPE_SERVER_CALL_CALL_WORK_H_
#define ISOSCOPE_SERVER_CALL_CALL_WORK_H_

#include <atomic>
#include <cstddef>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/memory_budget.h"
#include "core/base/monotonic_time.h"
#include "server/access/access_control.h"
#include "server/admission/admission.h"

namespace isoscope::server {

// Cancel is thread-safe. GiveBackShare may run beside the work. The other functions are for one
// thread at a time, in this order.
class CallWork {
 public:
  // `queue` outlives the work, which ends at `deadline`.
  CallWork(Admission* queue, base::MonotonicTime deadline)
      : queue_(*queue), cancellation_(deadline) {}

  // Checks the bytes that were sent to the caller, then begins a use. A caller above its limits
  // must not take a place that another could have. RESOURCE_EXHAUSTED as Caller.
  absl::Status TakeUse(const Caller& caller, CallerUse use);
  // Takes a frame of the caller's rate. If there is none, returns the use. Errors as Caller.
  // REQUIRES: TakeUse succeeded.
  absl::Status TakeRate(bool is_moving);
  // Returns use and rate, because something else refuses the work.
  void ReturnShare();

  // Takes a place for `client` (Admission::Admit). If there is none, returns the share.
  absl::Status TakePlace(const std::string& client);
  // Runs `work` as Admission does. If the work was evicted, returns the rate first. This object
  // outlives the call of Schedule and that of `work`. REQUIRES: it has a place.
  void Schedule(Admission::Work work);
  // Ends the wait and the work.
  void Cancel();
  [[nodiscard]] const base::Cancellation& cancellation() const { return cancellation_; }

  // Keeps memory until the end of this object. Returns the error if there is none.
  absl::Status KeepMemory(absl::StatusOr<base::MemoryBudget::Reservation> memory);
  // Returns all memory above `bytes`. No effect without memory.
  void ShrinkMemory(std::size_t bytes);
  // Transfers the memory, at most `bytes` of it, to an answer that outlives the work.
  std::optional<base::MemoryBudget::Reservation> ReleaseMemory(std::size_t bytes);

  // The thread is free for other work. Call before the client gets its answer, as the next one.
  void GiveBackPlace() { place_.reset(); }
  // The caller may begin another work.
  void GiveBackShare() { use_.reset(); }

 private:
  Admission& queue_;
  base::Cancellation cancellation_;
  Caller caller_;
  std::optional<CallerSlot> use_;
  bool has_rate_ = false;  // a frame of the rate was taken, and may still be returned
  std::optional<Admission::Place> place_;
  std::atomic<Admission::Ticket> ticket_{0};  // of the place; 0: there was none
  std::optional<base::MemoryBudget::Reservation> memory_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_CALL_CALL_WORK_H_
