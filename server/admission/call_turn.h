// The turn of one call among others: its place, its deadline, and the cancellation that ends both
// the wait and the work.

#ifndef ISOSCOPE_SERVER_ADMISSION_CALL_TURN_H_
#define ISOSCOPE_SERVER_ADMISSION_CALL_TURN_H_

#include <atomic>
#include <optional>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/monotonic_time.h"
#include "server/admission/admission.h"

namespace isoscope::server {

// Cancel is thread-safe. The other functions are for one thread at a time.
class CallTurn {
 public:
  // `admission` outlives the turn. The call ends at `deadline`.
  CallTurn(Admission* admission, base::MonotonicTime deadline)
      : admission_(*admission), cancellation_(deadline) {}

  // Takes a place for `client` (Admission::Admit), and keeps it until GiveBack.
  absl::Status TakePlace(const std::string& client) { return Keep(admission_.Admit(client)); }
  // Keeps a place that the admission gave. Returns the error if there is none.
  absl::Status Keep(absl::StatusOr<Admission::Place> place) {
    if (!place.ok()) {
      return place.status();
    }
    ticket_.store(place->ticket());
    place_.emplace(*std::move(place));
    return absl::OkStatus();
  }
  // Runs `work` as Admission does. The caller owns the turn until this returns. REQUIRES: a place
  // is kept.
  void Schedule(Admission::Work work) {
    admission_.Schedule(ticket_.load(), cancellation_.deadline(), std::move(work));
    if (cancellation_.is_cancelled()) {  // cancelled before Leave had a ticket
      admission_.Leave(ticket_.load());
    }
  }
  void Cancel() {
    cancellation_.Cancel();
    admission_.Leave(ticket_.load());
  }
  void GiveBack() { place_.reset(); }

  [[nodiscard]] const base::Cancellation& cancellation() const { return cancellation_; }

 private:
  Admission& admission_;
  base::Cancellation cancellation_;
  std::optional<Admission::Place> place_;
  std::atomic<Admission::Ticket> ticket_{0};  // of the place; 0: there was none
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_ADMISSION_CALL_TURN_H_
