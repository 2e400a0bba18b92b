#include "client-cli/terminal/send_times.h"

#include <optional>

#include "absl/time/time.h"
#include "gtest/gtest.h"

namespace isoscope::cli {
namespace {

absl::Time At(int seconds) { return absl::UnixEpoch() + absl::Seconds(seconds); }

// Symptom: with states under way, a frame had the age of the newest one, which it did not show.
TEST(SendTimesTest, AFrameHasTheTimeOfItsOwnStateAndNotOfANewerOne) {
  SendTimes times;
  times.NoteSent(1, At(10));
  times.NoteSent(2, At(11));
  times.NoteSent(3, At(12));
  EXPECT_EQ(times.TimeOf(1), At(10));
  EXPECT_EQ(times.TimeOf(1), At(10)) << "a moving frame, then the exact one";
  EXPECT_EQ(times.TimeOf(3), At(12)) << "the server may skip states";
}

TEST(SendTimesTest, AStateThatWasNotSentHasNoTime) {
  SendTimes times;
  EXPECT_EQ(times.TimeOf(1), std::nullopt);
  times.NoteSent(2, At(10));
  EXPECT_EQ(times.TimeOf(1), std::nullopt);
  EXPECT_EQ(times.TimeOf(3), std::nullopt);
  EXPECT_EQ(times.TimeOf(2), std::nullopt) << "forgotten, since a newer frame has come";
}

}  // namespace
}  // namespace isoscope::cli
