#include "bench/commands.h"

#include <sstream>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "client-cli/commands.h"
#include "core/cli/interrupt.h"

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
  const int exit_code = cli::RunCommandLine(arguments, Commands(),
                                            {.out = &out, .err = &err, .interrupt = &interrupt});
  return {exit_code, out.str(), err.str()};
}

TEST(BenchCommandsTest, HelpOfEachHasUsageExamplesAndDefaults) {
  for (const cli::Command& command : Commands()) {
    const Outcome outcome = RunBench({"help", command.name});
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_THAT(outcome.out, HasSubstr("\nUsage: isoscope " + command.name + " " + command.usage));
    EXPECT_THAT(outcome.out, HasSubstr("Examples:\n  isoscope " + command.name));
    EXPECT_THAT(outcome.out, HasSubstr("default:"));
  }
}

TEST(BenchCommandsTest, TheFirstWordAloneListsTheSecondOnes) {
  const Outcome outcome = RunBench({"bench"});
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_THAT(outcome.err, HasSubstr("'bench' is the first of two words"));
  const Outcome help = RunBench({"bench", "--help"});
  EXPECT_EQ(help.exit_code, 0);
  for (const cli::Command& command : Commands()) {
    EXPECT_THAT(outcome.err, HasSubstr(command.name));
    EXPECT_THAT(help.out, HasSubstr("  " + command.name));
  }
}

}  // namespace
}  // namespace isoscope::bench
