// The least speed at which the client of an export must take it. No threads, no clock of its own.
//
// A fast client waits for the coordinator. A slow one makes the coordinator wait, with a thread and
// memory. This waiting comes out of an allowance. Each chunk refills it by the time that the chunk
// may take at the least rate:
//
//   allowance 60 s, 64 KiB/s: a chunk of 1 MiB refills 16 s. A client that takes 50 s for each has
//   26 s left after the first, and is cut 26 s into the second.

#ifndef ISOSCOPE_SERVER_ADMISSION_EXPORT_PACE_H_
#define ISOSCOPE_SERVER_ADMISSION_EXPORT_PACE_H_

#include <cstddef>
#include <optional>

#include "absl/time/time.h"

#include "core/base/monotonic_time.h"

namespace isoscope::server {

struct ExportLimits {
  // Limit of the whole export, from its turn to its last chunk.
  absl::Duration max_duration = absl::Hours(2);
  // The coordinator waits for the client at most this long, plus the time of the chunks at the
  // least rate.
  absl::Duration allowance = absl::Minutes(1);
  std::size_t least_bytes_per_second = std::size_t{64} * 1024;  // > 0
};

// Thread-compatible. Times never go back.
class ExportPace {
 public:
  ExportPace(const ExportLimits& limits, base::MonotonicTime begin)
      : limits_(limits), begin_(begin), left_(limits.allowance) {}

  void OnWriteBegun(base::MonotonicTime now) { write_begin_ = now; }
  void OnWriteDone(std::size_t bytes, base::MonotonicTime now);

  enum class Verdict { kGoesOn, kTooSlow, kTooLong };
  [[nodiscard]] Verdict Judge(base::MonotonicTime now) const;
  // Before this time the verdict stays kGoesOn in any case.
  [[nodiscard]] base::MonotonicTime NextJudgement(base::MonotonicTime now) const;

 private:
  // The time at which the write under way has used up the allowance, or one that began now would
  // have.
  [[nodiscard]] base::MonotonicTime SlowTime(base::MonotonicTime now) const {
    return write_begin_.value_or(now) + left_;
  }

  const ExportLimits limits_;
  const base::MonotonicTime begin_;
  absl::Duration left_;                             // of the allowance
  std::optional<base::MonotonicTime> write_begin_;  // none: no write is under way
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_ADMISSION_EXPORT_PACE_H_
