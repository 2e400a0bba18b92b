// What the exact frame of a view is expected to take, from the frames of the stream so far. No clock
// of its own.
//
// A frame of a level works on the active blocks of that level. So frames are known by the bytes of
// these, whatever of them is hidden or in memory:
//
//   * Of about as many bytes as an exact frame that was seen (from half of them to twice as many): its
//     time, in proportion. Exact frames have more samples and effects than moving ones.
//   * Of at most twice as many bytes as another frame: the same, with the one that is nearest.
//   * Of more: on the line through the frames of the fewest and of the most bytes, if the latter has
//     four times as many. It rises by at least 1 s for 8 GiB.
//   * Else 1 s for each GiB that is not seen yet.

#ifndef ISOSCOPE_SERVER_INTERACT_EXACT_COST_H_
#define ISOSCOPE_SERVER_INTERACT_EXACT_COST_H_

#include <array>
#include <cstddef>
#include <cstdint>

#include "absl/time/time.h"

namespace isoscope::server {

// Thread-compatible.
class ExactCost {
 public:
  // A frame with so many bytes of active blocks took `duration`.
  void OnFrame(std::int64_t active_bytes, absl::Duration duration, bool is_exact);
  // Returns the time that a frame is expected to take. `active_bytes` >= 0.
  [[nodiscard]] absl::Duration Expected(std::int64_t active_bytes) const;

 private:
  // Frames of 2^(i-1) to 2^i - 1 bytes: the last of them count most.
  struct Seen {
    double bytes = 0;  // 0: none
    absl::Duration duration;
  };
  using Table = std::array<Seen, 65>;

  // Returns the frame of a table whose bytes are nearest, of those that have at least half as many;
  // null if there is none.
  static const Seen* Nearest(const Table& table, double bytes);

  Table exact_;
  Table others_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_INTERACT_EXACT_COST_H_
