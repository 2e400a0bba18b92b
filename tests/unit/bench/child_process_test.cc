#include "bench/child_process.h"

#include <string>
#include <thread>
#include <vector>

#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/cli/interrupt.h"
#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::bench {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::HasSubstr;

std::vector<std::string> Shell(const std::string& script) { return {"sh", "-c", script}; }

TEST(ChildProcessTest, BothTextsAndTheExitCodeComeBack) {
  cli::Interrupt interrupt;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ChildResult result,
                                RunChild(Shell("echo out; echo err >&2; exit 3"), "", &interrupt));
  EXPECT_EQ(result.exit_code, 3);
  EXPECT_EQ(result.out, "out\n");
  EXPECT_EQ(result.err, "err\n");
}

TEST(ChildProcessTest, MuchOnBothPipesDoesNotBlockEither) {
  cli::Interrupt interrupt;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const ChildResult result,
      RunChild(Shell("head -c 1000000 /dev/zero >&2; head -c 2000000 /dev/zero"), "", &interrupt));
  EXPECT_EQ(result.err.size(), 1'000'000);
  EXPECT_EQ(result.out.size(), 2'000'000);
}

TEST(ChildProcessTest, InputIsEmptyAndTheFolderIsTheOneAskedFor) {
  const TempDir folder;
  cli::Interrupt interrupt;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ChildResult result,
                                RunChild(Shell("cat; pwd -P"), folder.path(), &interrupt));
  EXPECT_EQ(LastLine(result.out), folder.path());
}

TEST(ChildProcessTest, ASignalThatEndsItShowsInTheExitCode) {
  cli::Interrupt interrupt;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ChildResult result,
                                RunChild(Shell("kill -KILL $$"), "", &interrupt));
  EXPECT_EQ(result.exit_code, 128 + 9);
}

TEST(ChildProcessTest, AProgramThatIsNotThereIsNamed) {
  cli::Interrupt interrupt;
  const absl::Status status = RunChild({"isoscope-no-such-program"}, "", &interrupt).status();
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kNotFound));
  EXPECT_THAT(std::string(status.message()), HasSubstr("isoscope-no-such-program"));
}

TEST(ChildProcessTest, AnInterruptEndsTheWholeGroup) {
  const TempDir folder;
  cli::Interrupt interrupt;
  std::thread presser([&] {
    while (!io::PathExists(folder.Sub("started"))) {
      absl::SleepFor(absl::Milliseconds(5));
    }
    interrupt.Trigger();
  });
  // The pipe would stay open as long as the grandchild lives.
  const absl::Status status =
      RunChild(Shell("sleep 1000 & touch started; wait"), folder.path(), &interrupt).status();
  presser.join();
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kCancelled));
}

TEST(ChildProcessTest, AnInterruptThatCameBeforeLetsNothingRun) {
  cli::Interrupt interrupt;
  interrupt.Trigger();
  EXPECT_THAT(RunChild({"sleep", "1000"}, "", &interrupt).status(),
              StatusIs(absl::StatusCode::kCancelled));
}

TEST(ChildProcessTest, TheLastLineIsTheLastThatSaysSomething) {
  EXPECT_EQ(LastLine("a\n  b \n\n \n"), "b");
  EXPECT_EQ(LastLine("\n"), "");
}

}  // namespace
}  // namespace isoscope::bench
