// Compares the clocks of two processes by the messages between them.
//
// Each message gives a bound, because none arrives before it was sent. With offset = what must be
// added to the peer's clock to get ours:
//
//   we sent at s, the peer received at r:   s <= r + offset   ->   offset >= s - r
//   the peer sent at s, we received at r:   s + offset <= r   ->   offset <= r - s
//
// The offset lies between the largest lower and the smallest upper bound. The middle is the best
// guess, and half of the distance is how far it may be off: half of the shortest round trip, once
// the time that the peer kept the message is taken away. Clocks that run at different speeds differ
// by less than that during a frame (50 parts in a million are 50 us a second).

#ifndef ISOSCOPE_CORE_BASE_CLOCK_ALIGNMENT_H_
#define ISOSCOPE_CORE_BASE_CLOCK_ALIGNMENT_H_

#include <optional>

#include "absl/time/time.h"

namespace isoscope::base {

// Times are durations since any fixed moment of the clock that they are of. Thread-compatible.
class ClockAlignment {
 public:
  // A message of ours.
  void AddSent(absl::Duration our_send, absl::Duration peer_receive);
  // A message of the peer.
  void AddReceived(absl::Duration peer_send, absl::Duration our_receive);

  // What must be added to a time of the peer's clock to get one of ours. With messages of one
  // direction alone: as if the fastest had taken no time. Without any: 0.
  [[nodiscard]] absl::Duration offset() const;
  // How far the offset may be off, either way; infinite unless there are messages both ways.
  [[nodiscard]] absl::Duration error() const;

 private:
  std::optional<absl::Duration> lower_;
  std::optional<absl::Duration> upper_;
};

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_CLOCK_ALIGNMENT_H_
