// Adapts the moving frames of an interactive stream to the connection and to the time that frames
// take. A slow connection lowers their JPEG quality, then their size; slow drawing takes a coarser
// level, if there may be one, then a smaller size. Then the rate falls.

#ifndef ISOSCOPE_SERVER_INTERACT_RATE_CONTROL_H_
#define ISOSCOPE_SERVER_INTERACT_RATE_CONTROL_H_

#include <optional>

#include "absl/time/time.h"

#include "core/base/monotonic_time.h"
#include "server/interact/level_ladder.h"
#include "server/interact/quality_ladder.h"

namespace isoscope::server {

struct MovingQuality {
  int jpeg_quality = 85;
  double scale = 1;           // factor for the sides of the picture
  int depth_grid_side = 192;  // points on the longer side
  // The frame is of this level, or of a coarser one that it asks for. Not set: the quick level is not
  // known yet.
  std::optional<int> least_level = 0;
};

// Thread-compatible.
class RateControl {
 public:
  static constexpr double kDefaultFramesPerSecond = 30;

  RateControl();

  // REQUIRES: > 0.
  void SetTarget(double frames_per_second) { period_ = absl::Seconds(1 / frames_per_second); }

  // Whether frames may be of a coarser level than they ask for. Default: they may not.
  void AllowCoarseLevels(bool are_allowed) { allows_levels_ = are_allowed; }
  // The next frames show another volume.
  void ForgetLevels() { levels_ = LevelLadder(); }

  // A moving frame took `duration` from its start to its picture; the next one could not begin
  // before.
  void OnDrawn(absl::Duration duration, base::MonotonicTime now, const DrawnLevels& levels = {});
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
  bool allows_levels_ = false;
  LevelLadder levels_;
  bool is_known_ = false;  // a frame has been shown
  absl::Duration mean_drawn_;
  // Least delays of this span of 5 seconds and of the one before.
  std::optional<absl::Duration> least_;
  std::optional<absl::Duration> least_before_;
  base::MonotonicTime span_start_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_INTERACT_RATE_CONTROL_H_
