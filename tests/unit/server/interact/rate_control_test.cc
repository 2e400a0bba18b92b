// Invented connections: what is sent on them, and that it settles.

#include "server/interact/rate_control.h"

#include <vector>

#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"

namespace isoscope::server {
namespace {

base::MonotonicTime At(double ms) { return base::MonotonicTime() + absl::Milliseconds(ms); }

constexpr double kPeriodMs = 1000.0 / 30;

// Shows a frame every period for `seconds`; its delay is delay_ms(quality). Returns the number of
// changes of quality.
template <typename DelayMs>
int ShowFrames(RateControl* rate, double begin_s, double seconds, const DelayMs& delay_ms) {
  int change_count = 0;
  MovingQuality last = rate->quality();
  for (double ms = begin_s * 1000; ms < (begin_s + seconds) * 1000; ms += kPeriodMs) {
    rate->OnShown(absl::Milliseconds(delay_ms(rate->quality())), absl::ZeroDuration(), At(ms));
    const MovingQuality now = rate->quality();
    change_count += now.jpeg_quality != last.jpeg_quality || now.scale != last.scale ? 1 : 0;
    last = now;
  }
  return change_count;
}

// A connection that was bad for an hour is tried anew within kMaxHold.
TEST(QualityLadderTest, TheWaitForAFinerStepIsBounded) {
  QualityLadder ladder(3);
  base::MonotonicTime now = base::MonotonicTime() + absl::Seconds(1'000'000);
  ladder.StartAt(1);
  ladder.OnLoad(9, 9, now);
  for (int round = 0; round < 20; ++round) {
    // A finer step, which has to be taken back at once.
    now += QualityLadder::kMaxHold + absl::Seconds(1);
    const std::size_t coarse = ladder.step();
    ladder.OnLoad(0.1, 0.1, now);
    ASSERT_EQ(ladder.step(), coarse - 1) << "round " << round;
    now += absl::Milliseconds(300);
    ladder.OnLoad(9, 9, now);
    ASSERT_EQ(ladder.step(), coarse) << "round " << round;
  }
}

TEST(RateControlTest, AFastConnectionKeepsTheFinestFrames) {
  RateControl rate;
  EXPECT_EQ(ShowFrames(&rate, 0, 30, [](const MovingQuality&) { return 3.0; }), 1)
      << "only the first frame is small";
  EXPECT_EQ(rate.quality().jpeg_quality, 85);
  EXPECT_EQ(rate.quality().scale, 1);
  EXPECT_EQ(rate.credits(), 2);
}

TEST(RateControlTest, ALongButWideConnectionGetsCreditsAndKeepsItsQuality) {
  RateControl rate;
  ShowFrames(&rate, 0, 10, [](const MovingQuality&) { return 150.0; });
  EXPECT_EQ(rate.quality().jpeg_quality, 85);
  EXPECT_EQ(rate.credits(), 1 + 5);
  EXPECT_EQ(rate.round_trip(), absl::Milliseconds(150));
}

TEST(RateControlTest, AnUnknownConnectionBeginsWithSmallFramesAndIsFineSoonIfItIsWide) {
  RateControl rate;
  EXPECT_LE(rate.quality().scale, 0.5);
  ShowFrames(&rate, 0, 1.5, [](const MovingQuality&) { return 150.0; });
  EXPECT_EQ(rate.quality().scale, 1);
  EXPECT_EQ(rate.quality().jpeg_quality, 85);
}

// A frame takes its bytes' time on the link, behind those before it.
TEST(RateControlTest, ANarrowConnectionsRoundTripIsNotTakenForTheTimeOfItsQueue) {
  RateControl rate;
  const auto delay = [](const MovingQuality& q) {
    const double kib = 130 * q.scale * q.scale * q.jpeg_quality / 85;
    return 80 + kib * 4 * (kib > 20 ? 3 : 1);  // 2 Mbit/s; a queue of three where frames are large
  };
  ShowFrames(&rate, 0, 20, delay);
  EXPECT_LE(rate.quality().scale, 0.5);
  EXPECT_LT(rate.round_trip(), absl::Milliseconds(200));
}

TEST(RateControlTest, FramesThatAreNotShownAtAllMakeTheNextOnesSmaller) {
  RateControl rate;
  rate.OnShown(absl::Milliseconds(10), absl::ZeroDuration(), At(0));
  EXPECT_EQ(rate.quality().scale, 1);
  for (int i = 1; i <= 10; ++i) {
    rate.OnOverdue(At(2000.0 * i));
  }
  EXPECT_EQ(rate.quality().scale, 0.25);
}

TEST(RateControlTest, QualityGoesBeforeSize) {
  RateControl rate;
  rate.OnShown(absl::Milliseconds(10), absl::ZeroDuration(), At(0));  // a fast one, at first
  std::vector<MovingQuality> seen;
  for (double ms = 1000; ms < 20000; ms += kPeriodMs) {
    rate.OnShown(absl::Milliseconds(rate.quality().scale > 0.5 ? 100 : 12), absl::ZeroDuration(),
                 At(ms));
    if (seen.empty() || seen.back().jpeg_quality != rate.quality().jpeg_quality ||
        seen.back().scale != rate.quality().scale) {
      seen.push_back(rate.quality());
    }
    if (rate.quality().scale <= 0.5) {
      break;
    }
  }
  ASSERT_GE(seen.size(), 5U);
  for (std::size_t i = 1; i < seen.size(); ++i) {
    EXPECT_LE(seen[i].jpeg_quality, seen[i - 1].jpeg_quality);
    EXPECT_LE(seen[i].scale, seen[i - 1].scale);
    EXPECT_TRUE(seen[i].scale == 1 || seen[i].jpeg_quality <= 45) << i;
  }
}

// A link that carries the frames of one setting and no finer ones: the finer one is tried less and
// less often.
TEST(RateControlTest, ANarrowConnectionSettlesWithoutOscillating) {
  RateControl rate;
  const auto delay = [](const MovingQuality& q) { return q.jpeg_quality > 60 ? 200.0 : 15.0; };
  rate.OnShown(absl::Milliseconds(10), absl::ZeroDuration(), At(0));
  ShowFrames(&rate, 1, 60, delay);
  EXPECT_LE(ShowFrames(&rate, 61, 120, delay), 12) << "a change and its way back each 20 s at most";
  EXPECT_LE(rate.quality().jpeg_quality, 75);
}

TEST(RateControlTest, AConnectionThatRecoversIsUsedAgain) {
  RateControl rate;
  rate.OnShown(absl::Milliseconds(10), absl::ZeroDuration(), At(0));
  ShowFrames(&rate, 1, 3, [](const MovingQuality&) { return 300.0; });
  EXPECT_LT(rate.quality().scale, 1);
  ShowFrames(&rate, 4, 60, [](const MovingQuality&) { return 10.0; });
  EXPECT_EQ(rate.quality().jpeg_quality, 85);
  EXPECT_EQ(rate.quality().scale, 1);
}

TEST(RateControlTest, SlowDrawingMakesFramesSmallerUntilTheRateIsReached) {
  RateControl rate;
  rate.OnShown(absl::Milliseconds(3), absl::ZeroDuration(), At(0));
  rate.SetTarget(30);
  for (double ms = 0; ms < 20000; ms += 50) {
    const double scale = rate.quality().scale;
    rate.OnDrawn(absl::Milliseconds(20 + 100 * scale * scale), At(ms));
  }
  EXPECT_LT(rate.quality().scale, 0.5);
  EXPECT_EQ(rate.quality().jpeg_quality, 85) << "drawing is not the network's fault";
}

TEST(RateControlTest, ALowTargetKeepsTheFullSize) {
  RateControl rate;
  rate.OnShown(absl::Milliseconds(3), absl::ZeroDuration(), At(0));
  rate.SetTarget(1);
  for (double ms = 0; ms < 20000; ms += 50) {
    rate.OnDrawn(absl::Milliseconds(400), At(ms));
  }
  EXPECT_EQ(rate.quality().scale, 1);
}

TEST(RateControlTest, ASlowDecoderCountsAsANarrowConnection) {
  RateControl rate;
  for (double ms = 0; ms < 10000; ms += 100) {
    rate.OnShown(absl::Milliseconds(105), absl::Milliseconds(100), At(ms));
  }
  EXPECT_LT(rate.quality().scale, 1);
  EXPECT_EQ(rate.round_trip(), absl::Milliseconds(5));
}

}  // namespace
}  // namespace isoscope::server
