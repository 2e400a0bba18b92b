#include "core/cli/man_page.h"

#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::cli {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

ProgramDescription Program() {
  return {.name = "tool",
          .summary = "Does things",
          .version = "1.2",
          .commands = {{.name = "do it",
                        .summary = "Does it",
                        .usage = "INPUT [OPTIONS]",
                        .examples = "  tool do it a\\b 'c'\n\n.starts with a dot\n",
                        .flags = {{.value_name = "INPUT", .help = "what"},
                                  {.names = {"--size", "-s"},
                                   .value_name = "N",
                                   .help = ".hidden is no command of roff",
                                   .group = "Looks",
                                   .environment = "TOOL_SIZE",
                                   .default_value = "3"},
                                  {.names = {"--caps"},
                                   .value_name = "MAP",
                                   .has_optional_value = true,
                                   .group = "Looks"}}}}};
}

TEST(ManPageTest, NamesOfPages) {
  EXPECT_EQ(ManPageName(Program(), "do it"), "tool-do-it");
  EXPECT_EQ(ManPageName(Program(), ""), "tool");
}

TEST(ManPageTest, ACommandHasItsFlagsWithGroupsDefaultsAndEnvironment) {
  const std::string page = CommandManPage(Program(), Program().commands[0]);
  EXPECT_THAT(page, HasSubstr(".TH TOOL-DO-IT 1 "));
  EXPECT_THAT(page, HasSubstr("tool\\-do\\-it \\- Does it\n"));
  EXPECT_THAT(page, HasSubstr(".SS Looks\n"));
  EXPECT_THAT(page, HasSubstr("\\fB\\-\\-size\\fR, \\fB\\-s\\fR \\fIN\\fR\n"));
  EXPECT_THAT(page, HasSubstr("(default: 3)"));
  EXPECT_THAT(page, HasSubstr("\\fBTOOL_SIZE\\fR"));
  EXPECT_THAT(page, HasSubstr("\\fB\\-\\-caps\\fR[=\\fIMAP\\fR]\n"));
  EXPECT_THAT(page, HasSubstr(".BR tool (1)\n"));
}

TEST(ManPageTest, OptionsBehindOtherHeadingsHaveTheirOwn) {
  ProgramDescription program = Program();
  for (FlagDescription& flag : program.commands[0].flags) {
    flag.group = flag.names.empty() ? "Input" : flag.names[0] == "--size" ? "Looks" : "Options";
  }
  EXPECT_THAT(CommandManPage(program, program.commands[0]),
              HasSubstr(".SS Options\n.TP\n\\fB\\-\\-caps"));
  program.commands[0].flags[0].group = "Options";
  EXPECT_THAT(CommandManPage(program, program.commands[0]), Not(HasSubstr(".SS Options")));
}

TEST(ManPageTest, NoTextBecomesACommandOfRoff) {
  const std::string page = CommandManPage(Program(), Program().commands[0]);
  EXPECT_THAT(page, HasSubstr("\n\\&.starts with a dot\n"));
  EXPECT_THAT(page, HasSubstr("\n\\&.hidden"));
  EXPECT_THAT(page, HasSubstr("a\\eb \\(aqc\\(aq"));
  EXPECT_THAT(page, Not(HasSubstr("\n\n")));
}

TEST(ManPageTest, AProgramNamesItsCommandsAndTheirPages) {
  const std::string page = ProgramManPage(Program(), "");
  EXPECT_THAT(page, HasSubstr("\\fBdo it\\fR\nDoes it\n"));
  EXPECT_THAT(page, HasSubstr(".BR tool\\-do\\-it (1)\n"));
}

}  // namespace
}  // namespace isoscope::cli
