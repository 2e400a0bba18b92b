#include "core/base/memory_budget.h"

#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"

namespace isoscope::base {

absl::StatusOr<MemoryBudget::Reservation> MemoryBudget::Reserve(std::size_t bytes,
                                                                const Cancellation& cancellation) {
  if (bytes > capacity_bytes_) {
    return absl::ResourceExhaustedError(absl::StrCat(bytes, " bytes are needed and at most ",
                                                     capacity_bytes_, " may be used for it"));
  }
  // A cancelled caller gets nothing, even where there is room.
  ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
  ISOSCOPE_RETURN_IF_ERROR(AwaitOrCancelled(cancellation, &mutex_, &freed_,
                                            [this, bytes]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
                                              if (free_bytes_ < bytes) {
                                                return false;
                                              }
                                              free_bytes_ -= bytes;
                                              return true;
                                            }));
  return Reservation(this, bytes);
}

void MemoryBudget::Release(std::size_t bytes) {
  MutexLock lock(&mutex_);
  free_bytes_ += bytes;
  freed_.SignalAll();  // threads wait for different numbers of bytes
}

}  // namespace isoscope::base
