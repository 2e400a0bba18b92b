#include "core/base/memory_budget.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"

#include "core/base/status_macros.h"

namespace isoscope::base {
namespace {

// How late a cancellation may be noticed.
constexpr absl::Duration kCancellationPoll = absl::Milliseconds(10);

}  // namespace

absl::StatusOr<MemoryBudget::Reservation> MemoryBudget::Reserve(std::size_t bytes,
                                                                const Cancellation& cancellation) {
  if (bytes > capacity_bytes_) {
    return absl::ResourceExhaustedError(absl::StrCat(bytes, " bytes are needed and at most ",
                                                     capacity_bytes_, " may be used for it"));
  }
  absl::MutexLock lock(&mutex_);
  const auto fits = [this, bytes]()
                        ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return free_bytes_ >= bytes; };
  do {
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
  } while (!mutex_.AwaitWithTimeout(
      absl::Condition(&fits),
      std::clamp(cancellation.deadline() - absl::Now(), absl::ZeroDuration(), kCancellationPoll)));
  free_bytes_ -= bytes;
  return Reservation(this, bytes);
}

void MemoryBudget::Release(std::size_t bytes) {
  absl::MutexLock lock(&mutex_);
  free_bytes_ += bytes;
}

}  // namespace isoscope::base
