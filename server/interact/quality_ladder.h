// A ladder of settings, from fine to coarse, on which interactive frames look for the finest one that
// a limit allows.

#ifndef ISOSCOPE_SERVER_INTERACT_QUALITY_LADDER_H_
#define ISOSCOPE_SERVER_INTERACT_QUALITY_LADDER_H_

#include <cstddef>

#include "absl/time/time.h"

#include "core/base/monotonic_time.h"

namespace isoscope::server {

// A position on a ladder of settings, 0 the finest. It coarsens quickly and refines slowly. A
// refinement that has to be undone doubles the wait before the next one, so that it does not
// oscillate. Thread-compatible.
class QualityLadder {
 public:
  static constexpr absl::Duration kStartHold = absl::Milliseconds(150);
  static constexpr absl::Duration kMinHold = absl::Seconds(1);
  static constexpr absl::Duration kMaxHold = absl::Seconds(30);
  // Above this load the ladder reacts at once.
  static constexpr double kSevereLoad = 2;

  explicit QualityLadder(std::size_t step_count) : step_count_(step_count) {}

  // Begins at a step, with short holds until the first overload.
  void StartAt(std::size_t step) {
    step_ = step;
    hold_ = kStartHold;
    is_starting_ = true;
  }
  // Moves to a step for another reason than load. Holds stay.
  void MoveTo(std::size_t step) {
    step_ = step;
    overload_count_ = 0;
    last_was_finer_ = false;
  }
  // `load`: use of the present setting as a share of the capacity; above 1 it is too fine.
  // `finer_load`: the predicted load of the next finer setting.
  void OnLoad(double load, double finer_load, base::MonotonicTime now);
  [[nodiscard]] std::size_t step() const { return step_; }

 private:
  std::size_t step_count_;
  std::size_t step_ = 0;
  int overload_count_ = 0;  // loads above 1 in a row
  absl::Duration hold_ = kMinHold;
  base::MonotonicTime last_change_;
  bool last_was_finer_ = false;
  bool is_starting_ = false;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_INTERACT_QUALITY_LADDER_H_
