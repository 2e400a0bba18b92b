// Adapts the moving frames of an interactive stream to the connection and to the time that frames
// take: first their JPEG quality, then their size, then their rate.

#ifndef ISOSCOPE_SERVER_INTERACT_RATE_CONTROL_H_
#define ISOSCOPE_SERVER_INTERACT_RATE_CONTROL_H_

#include <cstddef>
#include <optional>

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

  explicit QualityLadder(std::size_t step_count) : step_count_(step_count) {}

  // Begins at a step, with short holds until the first overload.
  void StartAt(std::size_t step) {
    step_ = step;
    hold_ = kStartHold;
    is_starting_ = true;
  }
  // `load`: use of the present setting as a share of the capacity; above 1 it is too fine.
  // `finer_load`: the predicted load of the next finer setting.
  void OnLoad(double load, double finer_load, base::MonotonicTime now);
  [[nodiscard]] std::size_t step() const { return step_; }

 private:
  const std::size_t step_count_;
  std::size_t step_ = 0;
  int overload_count_ = 0;  // loads above 1 in a row
  absl::Duration hold_ = kMinHold;
  base::MonotonicTime last_change_;
  bool last_was_finer_ = false;
  bool is_starting_ = false;
};

struct MovingQuality {
  int jpeg_quality = 85;
  double scale = 1;           // factor for the sides of the picture
  int depth_grid_side = 192;  // points on the longer side
};

// Thread-compatible.
class RateControl {
 public:
  static constexpr double kDefaultFramesPerSecond = 30;

  RateControl();

  // REQUIRES: > 0.
  void SetTarget(double frames_per_second) { period_ = absl::Seconds(1 / frames_per_second); }

  // A moving frame took `duration` from its start to its picture; the next one could not begin
  // before.
  void OnDrawn(absl::Duration duration, base::MonotonicTime now);
  // A moving frame was shown `delay` after it was sent. `decode`: the client's share of that.
  void OnShown(absl::Duration delay, absl::Duration decode, base::MonotonicTime now);

  // A moving frame was not shown within InteractiveSchedule::kShownTimeout.
  void OnOverdue(base::MonotonicTime now);

  [[nodiscard]] MovingQuality quality() const;
  // The frames that should be under way, >= 2: more if the round trip is longer than a frame.
  [[nodiscard]] int credits() const;
  // The least delay of the last 5 to 10 seconds, without decoding.
  [[nodiscard]] absl::Duration round_trip() const;

 private:
  absl::Duration period_ = absl::Seconds(1 / kDefaultFramesPerSecond);
  QualityLadder network_;
  QualityLadder size_;
  bool is_known_ = false;  // a frame has been shown
  absl::Duration mean_drawn_;
  // Least delays of this span of 5 seconds and of the one before.
  std::optional<absl::Duration> least_;
  std::optional<absl::Duration> least_before_;
  base::MonotonicTime span_start_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_INTERACT_RATE_CONTROL_H_
