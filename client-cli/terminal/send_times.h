// When a viewer sent each of its states, so that a frame's latency is that of its own state.

#ifndef ISOSCOPE_CLIENT_CLI_TERMINAL_SEND_TIMES_H_
#define ISOSCOPE_CLIENT_CLI_TERMINAL_SEND_TIMES_H_

#include <cstdint>
#include <deque>
#include <optional>
#include <utility>

#include "absl/time/time.h"

namespace isoscope::cli {

// Thread-compatible.
class SendTimes {
 public:
  // Sequence numbers ascend.
  void NoteSent(std::int64_t sequence_number, absl::Time time) {
    sent_.emplace_back(sequence_number, time);
  }

  // Returns when the state was sent; nothing if that is not known. Frames answer in the order of
  // states, so what lies before is forgotten. A state may have several frames.
  std::optional<absl::Time> TimeOf(std::int64_t sequence_number) {
    while (!sent_.empty() && sent_.front().first < sequence_number) {
      sent_.pop_front();
    }
    if (sent_.empty() || sent_.front().first != sequence_number) {
      return std::nullopt;
    }
    return sent_.front().second;
  }

 private:
  std::deque<std::pair<std::int64_t, absl::Time>> sent_;
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_TERMINAL_SEND_TIMES_H_
