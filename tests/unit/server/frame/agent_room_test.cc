#include "server/frame/agent_room.h"

#include <cstddef>
#include <string>
#include <thread>
#include <vector>

#include "gtest/gtest.h"

namespace isoscope::server {
namespace {

TEST(AgentRoomTest, TheLastRefusalOfADatasetCountsForAMinute) {
  base::MonotonicTime now = base::MonotonicNow();
  AgentRoom room([&] { return now; });
  EXPECT_EQ(room.MostPixels("a", 0), 0U);
  room.Note("a", 0, 1000);
  room.Note("a", 8, 100);
  room.Note("b", 0, 7);
  EXPECT_EQ(room.MostPixels("a", 0), 1000U);
  EXPECT_EQ(room.MostPixels("a", 8), 100U);
  EXPECT_EQ(room.MostPixels("b", 0), 7U);
  EXPECT_EQ(room.MostPixels("b", 8), 0U);
  now += AgentRoom::kMaxAge / 2;
  room.Note("a", 0, 500);
  now += AgentRoom::kMaxAge / 2 + absl::Seconds(1);
  EXPECT_EQ(room.MostPixels("a", 0), 500U);
  EXPECT_EQ(room.MostPixels("b", 0), 0U) << "an agent may have a new limit";
  now += AgentRoom::kMaxAge;
  EXPECT_EQ(room.MostPixels("a", 0), 0U);
}

TEST(AgentRoomTest, TheOldestDatasetIsForgottenFirst) {
  AgentRoom room;
  for (std::size_t i = 0; i <= AgentRoom::kMaxEntries; ++i) {
    room.Note(std::to_string(i), 0, i + 1);
  }
  EXPECT_EQ(room.MostPixels("0", 0), 0U);
  EXPECT_EQ(room.MostPixels("1", 0), 2U);
  EXPECT_EQ(room.MostPixels(std::to_string(AgentRoom::kMaxEntries), 0), AgentRoom::kMaxEntries + 1);
}

TEST(AgentRoomTest, FramesOfManyThreadsNoteAndAskAtOnce) {
  AgentRoom room;
  std::vector<std::thread> frames;
  for (std::size_t i = 0; i < 4; ++i) {
    frames.emplace_back([&room, i] {
      for (std::size_t pixels = 1; pixels <= 200; ++pixels) {
        room.Note(std::to_string(i), 0, pixels);
        EXPECT_EQ(room.MostPixels(std::to_string(i), 0), pixels);
        EXPECT_LE(room.MostPixels(std::to_string((i + 1) % 4), 0), 200U);
      }
    });
  }
  for (std::thread& frame : frames) {
    frame.join();
  }
}

}  // namespace
}  // namespace isoscope::server
