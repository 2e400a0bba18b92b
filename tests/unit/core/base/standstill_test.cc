// A process whose threads wait, and processes with one that works.

#include "core/base/standstill.h"

#include <unistd.h>

#include <array>
#include <atomic>
#include <thread>

#include "absl/time/clock.h"
#include "gtest/gtest.h"

namespace isoscope::base {
namespace {

constexpr absl::Duration kInterval = absl::Milliseconds(10);

TEST(StandstillWatchTest, AProcessWhoseThreadsAllWaitStandsStill) {
  std::array<int, 2> ends{};
  ASSERT_EQ(pipe(ends.data()), 0);
  std::thread waits([&] {
    char byte = 0;
    static_cast<void>(!read(ends[0], &byte, 1));  // as an open or a read that never returns
  });
  StandstillWatch watch(3);
  int samples = 1;
  constexpr int kMaxSamples = 6000;  // patience for a slow machine
  while (!watch.Sample() && samples < kMaxSamples) {
    absl::SleepFor(kInterval);
    ++samples;
  }
  EXPECT_LT(samples, kMaxSamples);
  EXPECT_GE(samples, 4) << "three samples at rest, after the first";
  ASSERT_EQ(write(ends[1], "x", 1), 1);
  waits.join();
  close(ends[0]);
  close(ends[1]);
}

TEST(StandstillWatchTest, AThreadThatWorksOrWaitsForAProcessorIsNoStandstill) {
  std::atomic<bool> is_done{false};
  std::thread works([&] {
    while (!is_done.load()) {
    }
  });
  StandstillWatch watch(1);
  for (int sample = 0; sample < 50; ++sample) {
    EXPECT_FALSE(watch.Sample());
    absl::SleepFor(absl::Milliseconds(1));
  }
  is_done = true;
  works.join();
}

}  // namespace
}  // namespace isoscope::base
