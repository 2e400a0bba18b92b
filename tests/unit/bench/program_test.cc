#include "bench/program.h"

#include <sstream>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/cli/interrupt.h"
#include "core/cli/program.h"

namespace isoscope::bench {
namespace {

using ::testing::HasSubstr;

struct Outcome {
  int exit_code = 0;
  std::string out;
  std::string err;
};

Outcome RunBench(const std::vector<std::string>& arguments) {
  cli::Interrupt interrupt;
  std::ostringstream out;
  std::ostringstream err;
  const int exit_code = cli::RunProgram(BenchProgram(), arguments,
                                        {.out = &out, .err = &err, .interrupt = &interrupt});
  return {exit_code, out.str(), err.str()};
}

TEST(BenchProgramTest, HelpOfEachHasUsageExamplesAndDefaults) {
  for (const cli::Command& command : BenchProgram().commands) {
    const Outcome outcome = RunBench({"help", command.name});
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_THAT(outcome.out,
                HasSubstr("\nUsage: isoscope-bench " + command.name + " " + command.usage));
    EXPECT_THAT(outcome.out, HasSubstr("Examples:\n  isoscope-bench " + command.name));
    EXPECT_THAT(outcome.out, HasSubstr("default:"));
  }
}

TEST(BenchProgramTest, HelpListsTheCommandsUnderTheNameOfTheProgram) {
  const Outcome help = RunBench({"--help"});
  EXPECT_EQ(help.exit_code, 0);
  EXPECT_THAT(help.out, HasSubstr("Usage: isoscope-bench COMMAND"));
  for (const cli::Command& command : BenchProgram().commands) {
    EXPECT_THAT(help.out, HasSubstr("  " + command.name));
  }
  EXPECT_THAT(RunBench({"frme"}).err,
              HasSubstr("isoscope-bench: 'frme' is no command, did you mean 'frame'?"));
}

}  // namespace
}  // namespace isoscope::bench
