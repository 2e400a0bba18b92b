#include "client-cli/output/sweep.h"

#include <sstream>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/cli/usage.h"
#include "tests/support/status_matchers.h"

namespace isoscope::cli {
namespace {

using ::testing::HasSubstr;

// Parses a command line of sweep and request flags.
struct Parsed {
  client::SweepFlags sweep;
  client::RequestFlags request;
};
absl::Status Parse(const std::vector<std::string>& arguments, Parsed* parsed) {
  FlagSet set;
  client::AddRequestFlags(&set, &parsed->request);
  client::AddSweepFlags(&set, &parsed->sweep, &parsed->request);
  return set.Parse(arguments);
}

TEST(SweepTest, FramesNeedNamesOfTheirOwnOrOneAnimation) {
  Parsed parsed;
  ISOSCOPE_ASSERT_OK(Parse({"--isovalue", "10:30:10", "--orbit", "90"}, &parsed));
  ISOSCOPE_EXPECT_OK(CheckUsage(parsed.sweep, parsed.request.selection, "a-%d.png"));
  ISOSCOPE_EXPECT_OK(CheckUsage(parsed.sweep, parsed.request.selection, "a-%03d.png"));
  ISOSCOPE_EXPECT_OK(CheckUsage(parsed.sweep, parsed.request.selection, "a.apng"));
  Parsed repeated;
  ISOSCOPE_ASSERT_OK(Parse({"--isovalue", "-1.5", "--repeat", "4"}, &repeated));
  ISOSCOPE_EXPECT_OK(CheckUsage(repeated.sweep, repeated.request.selection, "a.png"))
      << "the last one is kept";
}

TEST(SweepTest, FlagsThatDoNotFitEachOtherAreWrongUsage) {
  struct Case {
    std::vector<std::string> arguments;
    std::string output;
    std::string message;
  };
  for (const Case& c : std::vector<Case>{
           {{"--isovalue", "1:3:1"}, "a.png", "put %d into the name"},
           {{"--isovalue", "1:3:1"}, "a-%3x.png", "3 frames would overwrite each other"},
           {{"--isovalue", "1", "--repeat", "36"}, "a-%i.png", "36 frames would overwrite"},
           {{"--isovalue", "1"}, "a-%d-%s.png", "'%s' is no number of a frame"},
           {{"--isovalue", "1:3:1"}, "a-%d.webp", "one file of all frames"},
           {{"--isovalue", "1", "--step", "0:3"}, "a.png", "--step names several steps"},
           {{"--isovalue", "1", "--step", "0:3", "--time", "2"}, "a.webp", "--time and --step"},
           {{"--isovalue", "1:3:1", "--repeat", "3"}, "a-%d.png", "which has 3 frames"},
           {{"--isovalue", "1", "--orbit", "10"}, "a.png", "--repeat N"},
           {{"--isovalue", "1", "--fps", "10"}, "a.png", "ends in .apng or .webp"}}) {
    Parsed parsed;
    ISOSCOPE_ASSERT_OK(Parse(c.arguments, &parsed));
    const absl::Status status = CheckUsage(parsed.sweep, parsed.request.selection, c.output);
    EXPECT_TRUE(IsUsageError(status)) << c.message;
    EXPECT_THAT(std::string(status.message()), HasSubstr(c.message));
  }
}

TEST(SweepTest, ProgressTellsTheTimeLeft) {
  EXPECT_EQ(FormatFrameProgress(0, 72, absl::Seconds(2)), "frame 0 of 72");
  EXPECT_EQ(FormatFrameProgress(12, 72, absl::Seconds(3)), "frame 12 of 72   15 s left");
}

TEST(SweepTest, ShortOrUnwatchedWorkShowsNoProgress) {
  std::ostringstream err;
  FrameProgress quick(10, &err, /*is_terminal=*/true);
  quick.Update(5);
  FrameProgress unwatched(10, &err, /*is_terminal=*/false);
  unwatched.Update(5);
  EXPECT_EQ(err.str(), "");
}

}  // namespace
}  // namespace isoscope::cli
