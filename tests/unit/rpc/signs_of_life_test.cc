#include "rpc/signs_of_life.h"

#include <atomic>
#include <string>

#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gtest/gtest.h"

#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::rpc {
namespace {

constexpr absl::Duration kLimit = absl::Seconds(60);

TEST(SignsOfLifeTest, TheyComeAgainAndAgainUntilTheStop) {
  std::atomic<int> count{0};
  absl::Notification third;
  SignsOfLife signs;
  signs.Start(absl::Milliseconds(1), [&] {
    if (++count == 3) {
      third.Notify();
    }
  });
  EXPECT_TRUE(third.WaitForNotificationWithTimeout(kLimit));
  signs.Stop();
  const int at_stop = count;
  absl::SleepFor(absl::Milliseconds(20));
  EXPECT_EQ(count, at_stop);
}

TEST(SignsOfLifeTest, NoneComesIfTheCallHasEndedBeforeItsStart) {
  std::atomic<int> count{0};
  SignsOfLife signs;
  signs.Stop();
  signs.Start(absl::ZeroDuration(), [&] { ++count; });
  absl::SleepFor(absl::Milliseconds(20));
  EXPECT_EQ(count, 0);
}

TEST(SignsOfLifeTest, WhateverAMessageCarriesIsMore) {
  isoscope::v1::ExportIsosurfaceResponse chunk;
  chunk.set_surface_index(3);
  chunk.mutable_origin();
  EXPECT_TRUE(IsSignOfLife(chunk));
  for (std::string* const part :
       {chunk.mutable_positions(), chunk.mutable_normals(), chunk.mutable_triangles()}) {
    *part = "x";
    EXPECT_FALSE(IsSignOfLife(chunk));
    part->clear();
  }
  chunk.mutable_measures();
  EXPECT_FALSE(IsSignOfLife(chunk));
}

}  // namespace
}  // namespace isoscope::rpc
