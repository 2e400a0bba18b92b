#include "server/interact/level_ladder.h"

#include <algorithm>
#include <cstdlib>

namespace isoscope::server {
namespace {

// How much longer a frame of a level takes than one of the next coarser level, if that was not
// measured. Those of a field of 512^3 samples take 1.5 times as long as of 256^3, and of 1024^3 2.6
// times as long as of 512^3.
constexpr double kGuessedRatio = 1.5;

// Frames in a row of another level than the one that was chosen: then the dataset lacks that one. One
// frame may have been begun before the choice.
constexpr int kMaxOthers = 3;

// The frames of a level that make its mean.
constexpr int kFramesOfRatio = 3;

}  // namespace

void LevelLadder::MoveTo(int level) {
  left_ = level_;
  level_ = level;
  seen_count_ = 0;
  other_count_ = 0;
}

bool LevelLadder::OnDrawn(const DrawnLevels& levels, absl::Duration duration,
                          base::MonotonicTime now) {
  range_ = levels;
  if (!level_.has_value()) {
    MoveTo(levels.drawn);
    steps_.StartAt(static_cast<std::size_t>(levels.drawn));
    return false;
  }
  const int nearest = std::clamp(*level_, levels.asked, std::max(levels.asked, levels.coarsest));
  if (nearest != *level_ || (levels.drawn != *level_ && ++other_count_ >= kMaxOthers)) {
    MoveTo(nearest != *level_ ? nearest : levels.drawn);
    steps_.MoveTo(static_cast<std::size_t>(*level_));
    left_.reset();
    seen_count_ = levels.drawn == *level_ ? 1 : 0;
    return false;
  }
  if (levels.drawn != *level_) {
    return false;
  }
  other_count_ = 0;
  if (++seen_count_ == 1) {
    return false;
  }
  absl::Duration& mean = means_[static_cast<std::size_t>(*level_)];
  mean = seen_count_ == 2 ? duration : (mean * 3 + duration) / 4;
  if (seen_count_ >= kFramesOfRatio) {
    NoteRatio(now);
  }
  return true;
}

void LevelLadder::NoteRatio(base::MonotonicTime now) {
  if (left_.has_value() && std::abs(*left_ - *level_) == 1) {
    const auto fine = static_cast<std::size_t>(std::min(*left_, *level_));
    if (means_[fine] > absl::ZeroDuration() && means_[fine + 1] > absl::ZeroDuration()) {
      ratios_[fine] = {.value = std::max(1.0, absl::FDivDuration(means_[fine], means_[fine + 1])),
                       .time = now};
    }
  }
  left_.reset();
}

void LevelLadder::OnLoad(double load, base::MonotonicTime now) {
  double finer_load = load;
  if (*level_ > 0) {
    const Ratio& ratio = ratios_[static_cast<std::size_t>(*level_ - 1)];
    const bool is_known = ratio.value > 0 && now - ratio.time < QualityLadder::kMaxHold;
    finer_load *= is_known ? ratio.value : kGuessedRatio;
  }
  steps_.OnLoad(load, finer_load, now);
  if (const int level = static_cast<int>(steps_.step()); level != *level_) {
    MoveTo(level);
  }
}

}  // namespace isoscope::server
