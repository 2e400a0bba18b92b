#include "core/cli/end_note.h"

#include <unistd.h>

#include <csignal>

#include "absl/time/time.h"
#include "gtest/gtest.h"

#include "core/base/process_interrupt.h"
#include "core/cli/interrupt.h"

namespace isoscope::cli {
namespace {

using ::testing::ExitedWithCode;

constexpr int kSignals = 128;  // the exit code without the signal's number

// A command whose threads all stand still.
[[noreturn]] void StandStillAfter(int signal) {
  auto* const interrupt = new Interrupt();
  interrupt->InstallForProcess();
  kill(getpid(), signal);
  while (true) {
    pause();
  }
}

TEST(EndNoteTest, ACommandThatStandsStillEndsWithItsNote) {
  ::testing::FLAGS_gtest_death_test_style = "threadsafe";
  EXPECT_EXIT(StandStillAfter(SIGINT), ExitedWithCode(kSignals + SIGINT),
              "ended by SIGINT while it waited for .* that does not answer\n");
  // Symptom: an interrupted copy did not say that it goes on, while a disk was slow.
  const auto with_note = [] {
    const EndNote other("nothing is kept");
    const EndNote note("the same command goes on");
    StandStillAfter(SIGTERM);
  };
  EXPECT_EXIT(with_note(), ExitedWithCode(kSignals + SIGTERM),
              "ended by SIGTERM while it waited for .* answer; the same command goes on\n");
}

// Whoever asks twice does not wait for the command's own sentence.
TEST(EndNoteTest, TheSecondSignalEndsWithTheNoteToo) {
  ::testing::FLAGS_gtest_death_test_style = "threadsafe";
  const auto twice = [] {
    const EndNote note("the same command goes on");
    const base::OrderlyEnd closes(absl::Hours(1));
    auto* const interrupt = new Interrupt();
    interrupt->InstallForProcess();
    kill(getpid(), SIGINT);
    interrupt->Wait();
    kill(getpid(), SIGINT);
    while (true) {
      pause();
    }
  };
  EXPECT_EXIT(twice(), ExitedWithCode(kSignals + SIGINT), "ended by SIGINT; the same command");
}

TEST(EndNoteTest, OneThatIsKeptCountsUntilTheProcessEnds) {
  ::testing::FLAGS_gtest_death_test_style = "threadsafe";
  const auto keep = [] {
    { EndNote("the same command goes on").Keep(); }
    StandStillAfter(SIGINT);
  };
  EXPECT_EXIT(keep(), ExitedWithCode(kSignals + SIGINT), "answer; the same command goes on");
}

TEST(EndNoteTest, TheLastOneThatLivesCounts) {
  EXPECT_EQ(EndNote::OfProcess(), "");
  {
    const EndNote outer("outer");
    {
      const EndNote inner("inner");
      EXPECT_EQ(EndNote::OfProcess(), "inner");
    }
    EXPECT_EQ(EndNote::OfProcess(), "outer");
  }
  EXPECT_EQ(EndNote::OfProcess(), "");
}

}  // namespace
}  // namespace isoscope::cli
