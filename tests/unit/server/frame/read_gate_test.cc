#include "server/frame/read_gate.h"

#include <atomic>
#include <cstddef>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

namespace isoscope::server {
namespace {

TEST(ReadGateTest, ReadsGoOnAtOnceWhileLittleWaits) {
  ReadGate gate(100);
  const ReadGate::Hold hold = gate.Add(100);
  bool was_read = false;
  gate.WhenRoom([&] { was_read = true; });
  EXPECT_TRUE(was_read);
}

TEST(ReadGateTest, AReadWaitsUntilEnoughIsTakenOff) {
  ReadGate gate(100);
  std::optional<ReadGate::Hold> first = gate.Add(60);
  std::optional<ReadGate::Hold> second = gate.Add(50);
  int reads = 0;
  gate.WhenRoom([&] { ++reads; });
  gate.WhenRoom([&] { ++reads; });
  EXPECT_EQ(reads, 0);
  second.reset();
  EXPECT_EQ(reads, 2);
  first.reset();
  EXPECT_EQ(reads, 2) << "each read comes once";
}

TEST(ReadGateTest, AHoldThatMovedIsTakenOffOnce) {
  ReadGate gate(10);
  std::optional<ReadGate::Hold> hold = gate.Add(20);
  std::optional<ReadGate::Hold> moved(std::move(*hold));
  hold.reset();
  int reads = 0;
  gate.WhenRoom([&] { ++reads; });
  EXPECT_EQ(reads, 0);
  moved.reset();
  EXPECT_EQ(reads, 1);
}

// Else the stream of a frame that failed would never end.
TEST(ReadGateTest, AnOpenedGateLetsEveryReadPassWhateverWaits) {
  ReadGate gate(0);
  const ReadGate::Hold hold = gate.Add(1000);
  int reads = 0;
  gate.WhenRoom([&] { ++reads; });
  gate.Open();
  EXPECT_EQ(reads, 1);
  gate.WhenRoom([&] { ++reads; });
  EXPECT_EQ(reads, 2);
}

TEST(ReadGateTest, EachReadComesOnceWithManyThreads) {
  constexpr int kStreams = 16;
  constexpr int kMessages = 300;
  ReadGate gate(40);
  std::atomic<int> read_count{0};
  std::vector<std::thread> threads;
  for (int s = 0; s < kStreams; ++s) {
    threads.emplace_back([&] {
      for (int m = 0; m < kMessages; ++m) {
        const ReadGate::Hold hold = gate.Add(10);
        gate.WhenRoom([&] { read_count.fetch_add(1); });
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_EQ(read_count.load(), kStreams * kMessages);
}

}  // namespace
}  // namespace isoscope::server
