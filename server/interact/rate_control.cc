// The setting comes from two ladders, one for the network and one for the machine. The coarser of
// their sizes applies. The machine's has levels below its sizes (level_ladder.h): a picture of a
// coarser level is as sharp on the screen as the volume allows, a smaller one is not. So sizes fall
// only at the coarsest level, and rise before a finer level is tried. The network's has no levels: a
// coarser level has no fewer bytes.
//
// The round trip of an unknown connection must be measured before frames queue on it. So a stream
// begins with small frames. If the first is shown quickly, the finest setting follows at once. Else
// the setting is refined in short steps until frames first queue.
//
// Network ladder. If a frame is shown later than the round trip of an idle connection by more than
// a frame's period, frames queue on the way. So the load is that delay over the period (at least 30
// ms, below which delays are noise). The load of a finer setting can't be predicted, so it is tried
// when the present one leaves half of the room.
//
// Machine ladder. The load is the time of drawing over the period; the picture is encoded while the
// next one is drawn. A part of a frame's time does not depend on its size (rays, extraction,
// messages). So half the pixels are assumed to save a third.

#include "server/interact/rate_control.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/base/monotonic_time.h"

namespace isoscope::server {
namespace {

struct NetworkStep {
  int jpeg_quality;
  double scale;
  int depth_grid_side;
};
// A grid of 128 has 32 KiB, which is as much as a picture of quality 45.
constexpr std::array<NetworkStep, 8> kNetworkSteps = {{{85, 1, 192},
                                                       {75, 1, 128},
                                                       {60, 1, 128},
                                                       {45, 1, 96},
                                                       {45, 0.75, 80},
                                                       {45, 0.5, 64},
                                                       {40, 0.375, 64},
                                                       {40, 0.25, 48}}};
constexpr std::array<double, 5> kSizes = {1, 0.75, 0.5, 0.375, 0.25};

// The first step of an unknown connection, and the delay below which a connection is fast.
constexpr std::size_t kFirstNetworkStep = 5;
constexpr absl::Duration kFastDelay = absl::Milliseconds(20);

constexpr double kOverdueLoad = 2 * QualityLadder::kSevereLoad;
constexpr absl::Duration kDelayNoise = absl::Milliseconds(30);
constexpr absl::Duration kSpan = absl::Seconds(5);

}  // namespace

RateControl::RateControl() : network_(kNetworkSteps.size()), size_(kSizes.size()) {
  network_.StartAt(kFirstNetworkStep);
}

void RateControl::OnDrawn(absl::Duration duration, base::MonotonicTime now,
                          const DrawnLevels& levels) {
  mean_drawn_ = mean_drawn_ == absl::ZeroDuration() ? duration : (mean_drawn_ * 3 + duration) / 4;
  const double load = absl::FDivDuration(duration, period_);
  if (allows_levels_) {
    if (!levels_.OnDrawn(levels, duration, now)) {
      return;
    }
    const bool is_its_turn = load > 1 ? levels_.can_coarsen() : levels_.can_refine();
    if (size_.step() == 0 && is_its_turn) {
      levels_.OnLoad(load, now);
      return;
    }
  }
  const std::size_t step = size_.step();
  const double ratio = step == 0 ? 1 : std::pow(kSizes[step - 1] / kSizes[step], 2);
  constexpr double kFixedShare = 1.0 / 3;
  size_.OnLoad(load, load * (kFixedShare + (1 - kFixedShare) * ratio), now);
}

void RateControl::OnShown(absl::Duration delay, absl::Duration decode, base::MonotonicTime now) {
  const absl::Duration on_the_way = std::max(delay - decode, absl::ZeroDuration());
  if (now - span_start_ >= kSpan) {
    least_before_ = least_;
    least_.reset();
    span_start_ = now;
  }
  least_ = std::min(least_.value_or(on_the_way), on_the_way);
  if (!is_known_) {
    is_known_ = true;
    if (on_the_way <= kFastDelay) {
      network_.StartAt(0);
      return;
    }
  }
  const absl::Duration queued = std::max(on_the_way - round_trip(), decode);
  const double load = absl::FDivDuration(queued, std::max(period_, kDelayNoise));
  network_.OnLoad(load, load < 0.5 ? 0 : 1, now);
}

void RateControl::OnOverdue(base::MonotonicTime now) { network_.OnLoad(kOverdueLoad, 1, now); }

absl::Duration RateControl::round_trip() const {
  if (!least_.has_value()) {
    return least_before_.value_or(absl::ZeroDuration());
  }
  return std::min(*least_, least_before_.value_or(*least_));
}

MovingQuality RateControl::quality() const {
  const NetworkStep& step = kNetworkSteps[network_.step()];
  return {.jpeg_quality = step.jpeg_quality,
          .scale = std::min(step.scale, kSizes[size_.step()]),
          .depth_grid_side = step.depth_grid_side,
          .least_level = allows_levels_ ? levels_.level() : std::optional<int>(0)};
}

int RateControl::credits() const {
  const absl::Duration frame = std::max(period_, mean_drawn_);
  const double frames_on_the_way = absl::FDivDuration(round_trip(), frame);
  return frames_on_the_way <= 1 ? 2
                                : 1 + static_cast<int>(std::ceil(std::min(frames_on_the_way, 7.0)));
}

}  // namespace isoscope::server
