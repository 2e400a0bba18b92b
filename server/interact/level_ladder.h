// Chooses the level of moving frames by the time that frames of each level take. No clock of its own.
//
// Frames of a level that is new to the stream read its blocks from disk. So the first frame after a
// change does not count. The time of the next finer level is predicted: by the ratio that the two
// had when the stream last changed between them, or else by a guess. Such a ratio is forgotten after
// QualityLadder::kMaxHold, since it depends on the view.

#ifndef ISOSCOPE_SERVER_INTERACT_LEVEL_LADDER_H_
#define ISOSCOPE_SERVER_INTERACT_LEVEL_LADDER_H_

#include <array>
#include <cstddef>
#include <optional>

#include "absl/time/time.h"

#include "core/base/monotonic_time.h"
#include "core/volume/volume_level.h"
#include "server/interact/quality_ladder.h"

namespace isoscope::server {

// The level of a frame, and those that it could have had.
struct DrawnLevels {
  int drawn = 0;
  int asked = 0;     // the finest that may be drawn: the one that the state asks for
  int coarsest = 0;  // of those that fit the surfaces; at least `asked`
};

// Thread-compatible. Times never go back.
class LevelLadder {
 public:
  // Takes the first frame's level as the first step.
  LevelLadder() : steps_(kLevelCount) {}

  // A frame is drawn. Returns false if its time says nothing about the present level.
  bool OnDrawn(const DrawnLevels& levels, absl::Duration duration, base::MonotonicTime now);
  // Use of the present level, as QualityLadder has it. REQUIRES: OnDrawn has returned true, and load
  // above 1 can_coarsen(), else can_refine().
  void OnLoad(double load, base::MonotonicTime now);

  [[nodiscard]] bool can_coarsen() const { return range_.coarsest > level_.value_or(0); }
  [[nodiscard]] bool can_refine() const { return range_.asked < level_.value_or(0); }
  // The level of the next frame; not set: no frame was drawn yet.
  [[nodiscard]] std::optional<int> level() const { return level_; }

 private:
  static constexpr std::size_t kLevelCount = volume::kMaxLevel + 1;

  // How much longer a frame of a level took than one of the next coarser level.
  struct Ratio {
    double value = 0;  // 0: not known
    base::MonotonicTime time;
  };

  void MoveTo(int level);
  void NoteRatio(base::MonotonicTime now);

  QualityLadder steps_;
  std::optional<int> level_;
  DrawnLevels range_;
  int seen_count_ = 0;       // frames of the level since it was taken
  int other_count_ = 0;      // frames of other levels, in a row
  std::optional<int> left_;  // the level before, until the ratio of the two is known
  std::array<absl::Duration, kLevelCount> means_;
  std::array<Ratio, kLevelCount> ratios_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_INTERACT_LEVEL_LADDER_H_
