// Compares the clocks of two processes by the messages between them.
//
// Each message gives a bound, because none arrives before it was sent. The offset is the time that
// must be added to the peer's clock to get ours:
//
//   we sent at s, the peer received at r:   s <= r + offset   ->   offset >= s - r
//   the peer sent at s, we received at r:   s + offset <= r   ->   offset <= r - s
//
// The offset lies between the largest lower and the smallest upper bound. The middle is the best
// guess, and its error is at most half of the distance. That is half of the shortest round trip,
// without the time that the peer kept the message. Clocks that run at different speeds differ by
// less than that during a frame (50 parts in a million are 50 us a second).

#ifndef ISOSCOPE_CORE_BASE_CLOCK_ALIGNMENT_H_
#define ISOSCOPE_CORE_BASE_CLOCK_ALIGNMENT_H_

#include <optional>

#include "absl/time/time.h"

namespace isoscope::base {

// Times are durations since any fixed moment of their own clock. Thread-compatible.
class ClockAlignment {
 public:
  // A message of ours.
  void AddSent(absl::Duration our_send, absl::Duration peer_receive);
  // A message of the peer.
  void AddReceived(absl::Duration peer_send, absl::Duration our_receive);

  // Returns the duration to add to a time of the peer's clock to get a time of our clock. If all
  // messages have one direction, it assumes that the fastest took no time. 0 without messages.
  [[nodiscard]] absl::Duration offset() const;
  // Returns the bound on the error of the offset, in either direction. Infinite unless there are
  // messages in both directions.
  [[nodiscard]] absl::Duration error() const;

 private:
  std::optional<absl::Duration> lower_;
  std::optional<absl::Duration> upper_;
};

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_CLOCK_ALIGNMENT_H_
