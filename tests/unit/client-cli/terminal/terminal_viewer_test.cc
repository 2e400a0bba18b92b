// The loop itself, on a terminal: tests/integration/terminal_program_test.cc.

#include "client-cli/terminal/terminal_viewer.h"

#include <optional>
#include <string>

#include "absl/strings/match.h"
#include "absl/time/time.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "wire/first_look.h"

namespace isoscope::cli {
namespace {

// The time of the newest state gave a frame 1 s where it had taken 5.
TEST(SentStatesTest, TheLatencyIsThatOfTheStateOfTheFrameWhileNewerOnesAreUnderWay) {
  const base::MonotonicTime start = base::MonotonicTime();
  SentStates sent;
  sent.Add(1, start);
  sent.Add(2, start + absl::Seconds(4));
  EXPECT_EQ(sent.TakeLatency(1, start + absl::Seconds(5)), absl::Seconds(5));
  EXPECT_EQ(sent.TakeLatency(2, start + absl::Seconds(6)), absl::Seconds(2));
  // The exact frame answers the same state.
  EXPECT_EQ(sent.TakeLatency(2, start + absl::Seconds(7)), absl::Seconds(3));
}

TEST(SentStatesTest, AFrameOfAnUnknownStateHasNoLatency) {
  SentStates sent;
  EXPECT_EQ(sent.TakeLatency(1, base::MonotonicTime()), std::nullopt);
  for (int sequence_number = 1; sequence_number <= 1000; ++sequence_number) {
    sent.Add(sequence_number, base::MonotonicTime());
  }
  EXPECT_EQ(sent.TakeLatency(1, base::MonotonicTime()), std::nullopt);
  EXPECT_EQ(sent.TakeLatency(1000, base::MonotonicTime()), absl::ZeroDuration());
  EXPECT_EQ(sent.TakeLatency(999, base::MonotonicTime()), std::nullopt);
}

TEST(FlagsOfFrameTest, NumbersAreReadAsTheSameBits) {
  isoscope::v1::RenderIsosurfaceRequest frame;
  frame.add_surfaces()->set_isovalue(0.1);
  frame.mutable_viewport()->set_width_px(640);
  frame.mutable_viewport()->set_height_px(480);
  frame.mutable_camera()->mutable_eye()->set_x(1.0 / 3);
  frame.mutable_camera()->mutable_up()->set_y(1);
  const ViewedSurfaces surfaces{.isovalue = 0.1};
  EXPECT_EQ(FlagsOfFrame(frame, surfaces),
            "--isovalue 0.1 --eye 0.3333333333333333,0.0,0.0 --target 0.0,0.0,0.0 --up 0.0,1.0,0.0 "
            "--width 640 --height 480");
  wire::AddFirstMaterial(&frame);
  frame.set_samples(4);
  EXPECT_EQ(FlagsOfFrame(frame, surfaces),
            "--isovalue 0.1 --eye 0.3333333333333333,0.0,0.0 --target 0.0,0.0,0.0 --up 0.0,1.0,0.0 "
            "--material soft --samples 4 --width 640 --height 480");
  ViewedSurfaces labels;
  labels.labels.push_back({.values = {3}, .is_smooth = true});
  EXPECT_TRUE(absl::StartsWith(FlagsOfFrame(frame, labels), "--label 3 --smooth-labels --eye "))
      << FlagsOfFrame(frame, labels);
  frame.mutable_level()->set_max_spacing_px(1.1);
  EXPECT_TRUE(absl::EndsWith(FlagsOfFrame(frame, labels), "--height 480 --max-spacing 1.1"));
  frame.mutable_level()->set_level(2);
  EXPECT_TRUE(absl::EndsWith(FlagsOfFrame(frame, labels), "--height 480 --level 2"));
  labels.isovalue = 2;
  EXPECT_TRUE(absl::StartsWith(FlagsOfFrame(frame, labels), "--isovalue 2.0 --label 3 --smooth"));
}

}  // namespace
}  // namespace isoscope::cli
