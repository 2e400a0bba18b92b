#include "partition-agent/play/play_detector.h"

#include <optional>
#include <ostream>
#include <random>
#include <vector>

#include "gtest/gtest.h"

namespace isoscope::agent {
namespace {

constexpr int kNone = -1;

struct Sequence {
  const char* name;
  int count;
  std::vector<int> frames;
  std::vector<int> guesses;  // after each frame; kNone
};
std::ostream& operator<<(std::ostream& out, const Sequence& sequence) {
  return out << sequence.name;
}

class PlayDetectorTest : public ::testing::TestWithParam<Sequence> {};

TEST_P(PlayDetectorTest, GuessesTheNextStep) {
  PlayDetector detector;
  std::vector<int> guesses;
  for (const int frame : GetParam().frames) {
    guesses.push_back(detector.Note("look", frame, GetParam().count).next.value_or(kNone));
  }
  EXPECT_EQ(guesses, GetParam().guesses);
}

INSTANTIATE_TEST_SUITE_P(
    Sequences, PlayDetectorTest,
    ::testing::Values(
        Sequence{"Forward", 50, {3, 4, 5, 6}, {kNone, 5, 6, 7}},
        Sequence{"Backward", 50, {9, 8, 7}, {kNone, 7, 6}},
        Sequence{"Turns", 50, {3, 4, 5, 4, 3}, {kNone, 5, 6, 3, 2}},
        Sequence{"TurnsTwice", 50, {3, 4, 5, 4, 5, 6}, {kNone, 5, 6, 3, 6, 7}},
        Sequence{"Strides", 50, {0, 5, 10, 15}, {kNone, kNone, 15, 20}},
        Sequence{"StridesBackward", 50, {40, 33, 26}, {kNone, kNone, 19}},
        Sequence{"StridesEnd", 50, {30, 40, 49}, {kNone, kNone, kNone}},
        Sequence{"StridesReachTheEnd", 41, {20, 30, 40}, {kNone, kNone, kNone}},
        Sequence{"LoopsForward", 50, {47, 48, 49, 0, 1}, {kNone, 49, 0, 1, 2}},
        Sequence{"LoopsBackward", 50, {1, 0, 49, 48}, {kNone, 49, 48, 47}},
        Sequence{"LoopOfThree", 3, {0, 1, 2, 0, 1}, {kNone, 2, 0, 1, 2}},
        Sequence{"LoopOfTwo", 2, {0, 1, 0, 1}, {kNone, 0, 1, 0}},
        Sequence{"TheSameStepAgain", 50, {3, 3, 4, 4, 4, 5}, {kNone, kNone, 5, 5, 5, 6}},
        Sequence{"OneStep", 1, {0, 0, 0}, {kNone, kNone, kNone}},
        Sequence{"Jumps", 50, {3, 30, 17, 41, 8}, {kNone, kNone, kNone, kNone, kNone}},
        Sequence{"JumpsThenPlays", 50, {30, 3, 4, 5, 20, 21}, {kNone, kNone, 5, 6, kNone, 22}},
        Sequence{
            "TwoClients", 50, {3, 30, 4, 31, 5, 32, 6}, {kNone, kNone, kNone, kNone, 6, 33, 7}},
        Sequence{"TwoClientsOneBackward",
                 50,
                 {3, 30, 4, 29, 5, 28},
                 {kNone, kNone, kNone, kNone, 6, 27}},
        Sequence{"TwoClientsOneFaster",
                 50,
                 {3, 30, 4, 5, 31, 6, 7, 32},
                 {kNone, kNone, kNone, 6, kNone, 7, 8, 33}},
        Sequence{"ThreeClients",
                 90,
                 {3, 30, 70, 4, 31, 71, 5, 32, 72},
                 {kNone, kNone, kNone, kNone, kNone, kNone, 6, 33, 73}}),
    [](const ::testing::TestParamInfo<Sequence>& of) { return std::string(of.param.name); });

TEST(PlayDetectorTest, KnowsClientsWhoTakeTurnsFromOneThatTurns) {
  PlayDetector detector;
  for (const int frame : {3, 30, 4, 31}) {
    detector.Note("look", frame, 50);
  }
  EXPECT_FALSE(detector.Note("look", 5, 50).follows_last);
  PlayDetector alone;
  alone.Note("look", 3, 50);
  EXPECT_TRUE(alone.Note("look", 2, 50).follows_last);
}

TEST(PlayDetectorTest, LooksDoNotMix) {
  PlayDetector detector;
  EXPECT_FALSE(detector.Note("a", 3, 50).next.has_value());
  EXPECT_FALSE(detector.Note("b", 4, 50).next.has_value());
  EXPECT_EQ(detector.Note("a", 4, 50).next, 5);
  EXPECT_EQ(detector.Note("b", 5, 50).next, 6);
}

TEST(PlayDetectorTest, AStepThatWasAppendedIsTheNextOne) {
  PlayDetector detector;
  detector.Note("look", 8, 10);
  EXPECT_EQ(detector.Note("look", 9, 10).next, 0);
  EXPECT_EQ(detector.Note("look", 9, 11).next, 10);
}

TEST(PlayDetectorTest, OldLooksAreForgotten) {
  PlayDetector detector;
  detector.Note("first", 3, 50);
  for (int i = 0; i < 100; ++i) {
    detector.Note(std::to_string(i), 3, 50);
  }
  EXPECT_FALSE(detector.Note("first", 4, 50).next.has_value());
}

// A guess costs reads, so people who jump about must seldom cause one.
TEST(PlayDetectorTest, RandomJumpsSeldomLookLikeAPlay) {
  PlayDetector detector;
  std::mt19937 random(5);  // NOLINT(cert-msc51-cpp): the same each time
  constexpr int kFrames = 10'000;
  int guesses = 0;
  for (int i = 0; i < kFrames; ++i) {
    const int count = 200;
    const PlayDetector::Guess guess =
        detector.Note("look", static_cast<int>(random() % 200), count);
    if (guess.next.has_value()) {
      ++guesses;
      EXPECT_GE(*guess.next, 0);
      EXPECT_LT(*guess.next, count);
    }
  }
  EXPECT_LT(guesses, kFrames / 20);
}

}  // namespace
}  // namespace isoscope::agent
