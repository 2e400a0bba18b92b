// Views of invented volumes: which level their moving frames settle on, and that they stay there.

#include "server/interact/level_ladder.h"

#include <functional>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "server/interact/rate_control.h"

namespace isoscope::server {
namespace {

base::MonotonicTime At(double ms) { return base::MonotonicTime() + absl::Milliseconds(ms); }

// The time of a frame of a level, of full size.
using LevelMs = std::function<double(int level)>;

// Draws frames one after the other, at most 30 a second, as a coordinator would.
class View {
 public:
  View(int asked, int coarsest, LevelMs level_ms)
      : asked_(asked), coarsest_(coarsest), level_ms_(std::move(level_ms)) {
    rate_.OnShown(absl::Milliseconds(3), absl::ZeroDuration(), At(0));  // a fast connection
    rate_.AllowCoarseLevels(true);
    rate_.SetTarget(30);
  }

  void Ask(int asked) { asked_ = asked; }
  void Take(LevelMs level_ms) { level_ms_ = std::move(level_ms); }
  RateControl& rate() { return rate_; }
  [[nodiscard]] int level() const { return drawn_; }
  [[nodiscard]] double scale() const { return rate_.quality().scale; }

  // Returns the number of changes of the level.
  int Move(double seconds) {
    int change_count = 0;
    for (const double end = now_ms_ + 1000 * seconds; now_ms_ < end;) {
      const MovingQuality quality = rate_.quality();
      const int least = quality.least_level.value_or(start_);
      const int level = std::max(asked_, std::min(least, std::max(coarsest_, asked_)));
      change_count += level != drawn_ ? 1 : 0;
      drawn_ = level;
      levels_.push_back(level);
      const double ms = 5 + (level_ms_(level) - 5) * quality.scale * quality.scale;
      now_ms_ += std::max(ms, 1000.0 / 30);
      rate_.OnDrawn(absl::Milliseconds(ms), At(now_ms_),
                    {.drawn = level, .asked = asked_, .coarsest = std::max(coarsest_, asked_)});
    }
    return change_count;
  }

  int start_ = 0;  // what the coordinator takes as long as nothing is known
  std::vector<int> levels_;

 private:
  RateControl rate_;
  int asked_;
  int coarsest_;
  LevelMs level_ms_;
  int drawn_ = -1;
  double now_ms_ = 0;
};

// Each finer level takes four times as long.
double Surface(int level) { return level == 0 ? 640 : level == 1 ? 160 : level == 2 ? 40 : 12; }

TEST(LevelLadderTest, AViewSettlesOnTheFinestLevelThatReachesTheRate) {
  for (const int start : {0, 2, 5}) {
    View view(0, 5, Surface);
    view.start_ = start;
    view.Move(20);
    EXPECT_EQ(view.level(), 3) << "from level " << start;
    EXPECT_EQ(view.scale(), 1) << "a coarser level goes before a smaller picture";
  }
}

TEST(LevelLadderTest, ASteadyViewTriesAFinerLevelLessAndLessOften) {
  View view(0, 5, Surface);
  view.Move(60);
  EXPECT_LE(view.Move(120), 10) << "a change and its way back each half minute at most";
}

TEST(LevelLadderTest, TheCoarsestLevelIsMadeSmallerIfItIsStillSlow) {
  View view(0, 2, [](int level) { return level == 2 ? 100.0 : 400.0; });
  view.Move(20);
  EXPECT_EQ(view.level(), 2);
  EXPECT_LT(view.scale(), 0.75);
}

TEST(LevelLadderTest, WithoutLevelsOnlyTheSizeChanges) {
  View with(0, 0, [](int) { return 120.0; });
  with.Move(20);
  EXPECT_EQ(with.level(), 0);
  EXPECT_LT(with.scale(), 0.75);
  EXPECT_EQ(with.rate().quality().least_level, 0);
}

TEST(LevelLadderTest, OneLevelIsTakenWhereItIsQuick) {
  View view(0, 1, [](int level) { return level == 0 ? 130.0 : 20.0; });
  view.Move(20);
  EXPECT_EQ(view.level(), 1);
  EXPECT_EQ(view.scale(), 1);
}

TEST(LevelLadderTest, AStateThatDoesNotAllowLevelsHasNone) {
  View view(0, 5, Surface);
  view.rate().AllowCoarseLevels(false);
  view.Move(5);
  EXPECT_EQ(view.level(), 0);
  EXPECT_LT(view.scale(), 1);
}

TEST(LevelLadderTest, NoFrameIsFinerThanItsStateAsks) {
  View view(3, 5, [](int) { return 6.0; });
  view.Move(10);
  for (const int level : view.levels_) {
    EXPECT_GE(level, 3);
  }
  EXPECT_EQ(view.level(), 3);
}

// Inside of a volume its nearest sample is at the eye, so the state asks for level 0.
TEST(LevelLadderTest, FlyingInsideIsAsCoarseAsItsTimeNeeds) {
  View view(2, 5, [](int level) { return level >= 2 ? 10.0 : 90.0; });
  view.Move(5);
  EXPECT_EQ(view.level(), 2);
  view.Ask(0);
  EXPECT_LE(view.Move(30), 10);
  EXPECT_EQ(view.level(), 2) << "finer levels are asked for, and too slow";
  view.Take([](int) { return 10.0; });
  view.Move(70);
  EXPECT_EQ(view.level(), 0) << "a view that has become quick gets them";
}

TEST(LevelLadderTest, AViewThatBecomesSlowIsCoarserWithinSeconds) {
  View view(0, 5, [](int level) { return level == 0 ? 20.0 : 10.0; });
  view.Move(10);
  ASSERT_EQ(view.level(), 0);
  view.Take(Surface);
  view.Move(3);
  EXPECT_EQ(view.level(), 3);
}

TEST(LevelLadderTest, TheFirstFrameAfterAChangeReadsItsBlocksAndDoesNotCount) {
  LevelLadder ladder;
  const DrawnLevels levels{.drawn = 2, .asked = 0, .coarsest = 4};
  EXPECT_FALSE(ladder.OnDrawn(levels, absl::Seconds(9), At(0))) << "the first one";
  EXPECT_EQ(ladder.level(), 2);
  EXPECT_FALSE(ladder.OnDrawn(levels, absl::Seconds(9), At(1)));
  EXPECT_TRUE(ladder.OnDrawn(levels, absl::Milliseconds(10), At(2)));
  EXPECT_TRUE(ladder.can_coarsen());
  EXPECT_TRUE(ladder.can_refine());
  ladder.OnLoad(3, At(1000));
  EXPECT_EQ(ladder.level(), 3);
  EXPECT_FALSE(ladder.OnDrawn(levels, absl::Milliseconds(10), At(1001))) << "begun before";
  const DrawnLevels coarser{.drawn = 3, .asked = 0, .coarsest = 4};
  EXPECT_FALSE(ladder.OnDrawn(coarser, absl::Seconds(9), At(1002)));
  EXPECT_TRUE(ladder.OnDrawn(coarser, absl::Milliseconds(5), At(1003)));
}

TEST(LevelLadderTest, ADatasetThatLacksTheLevelIsFollowed) {
  LevelLadder ladder;
  for (int i = 0; i < 4; ++i) {
    ladder.OnDrawn({.drawn = 1, .asked = 0, .coarsest = 1}, absl::Milliseconds(50), At(i));
  }
  ASSERT_EQ(ladder.level(), 1);
  ladder.OnDrawn({.drawn = 0, .asked = 0, .coarsest = 0}, absl::Milliseconds(50), At(9));
  EXPECT_EQ(ladder.level(), 0);
  EXPECT_FALSE(ladder.can_coarsen());
}

}  // namespace
}  // namespace isoscope::server
