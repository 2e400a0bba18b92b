#include "core/cli/progress_line.h"

#include <cstdint>
#include <ostream>
#include <sstream>
#include <thread>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/cli/flags.h"

namespace isoscope::cli {
namespace {

using ::testing::HasSubstr;

TEST(ProgressLineTest, TextDoesNotSteerTheTerminal) {
  std::ostringstream err;
  {
    ProgressLine line(&err, /*is_terminal=*/true);
    line.UpdateNow("waiting for \x1b]0;a\x07");
  }
  EXPECT_EQ(err.str(), "\rwaiting for ?]0;a?\x1b[K\r\x1b[K");
}

// Symptom: with --quiet a line came each ten seconds where standard error was no terminal.
TEST(ProgressLineTest, AQuietCommandHasNone) {
  for (const bool is_terminal : {false, true}) {
    std::ostringstream err;
    const Context context{.err = &err, .err_is_terminal = is_terminal};
    for (const Context& quiet : {QuietContext(context), WithoutProgress(context)}) {
      {
        ProgressLine line(quiet.err, quiet.err_is_terminal);
        line.UpdateNow("copying");
      }
      EXPECT_EQ(err.str(), "");
      *quiet.err << "isoscope: a warning" << std::endl;
      EXPECT_EQ(err.str(), "isoscope: a warning\n");
      err.str("");
    }
  }
}

// Two quiet commands at once wrote to one standard error, that of the later one.
TEST(ProgressLineTest, QuietCommandsOfTwoThreadsHaveTheirOwnErrors) {
  std::ostringstream err;
  std::ostringstream other_err;
  const Context quiet = QuietContext({.err = &err});
  std::thread([&other_err, &quiet] {
    const Context other = QuietContext({.err = &other_err});
    *other.err << "of the other" << std::flush;
    *quiet.err << "of this" << std::flush;
    EXPECT_NE(other.out, quiet.out);
  }).join();
  EXPECT_EQ(err.str(), "of this");
  EXPECT_EQ(other_err.str(), "of the other");
}

TEST(ProgressLineTest, ProgressTellsRateAndTimeLeft) {
  constexpr std::int64_t kMiB = 1 << 20;
  EXPECT_EQ(FormatProgress("writing blocks", 25 * kMiB, 100 * kMiB, absl::Seconds(5)),
            "writing blocks    25 %  25.0 of 100.0 MiB  5.0 MiB/s  15 s left");
  EXPECT_EQ(FormatProgress("writing blocks", 0, 100 * kMiB, absl::ZeroDuration()),
            "writing blocks     0 %  0.0 of 100.0 MiB");
  EXPECT_THAT(FormatProgress("writing blocks", 101 * kMiB, 100 * kMiB, absl::Seconds(5)),
              HasSubstr("100 %"));
}

TEST(ProgressLineTest, ProgressOfShortWorkPrintsNothing) {
  for (const bool is_terminal : {false, true}) {
    std::ostringstream err;
    {
      ProgressLine line(&err, is_terminal);
      line.Update("writing blocks", 1, 2);
    }
    EXPECT_EQ(err.str(), "");
  }
}

}  // namespace
}  // namespace isoscope::cli
