// Tests the text of the scripts. tests/integration/completion_test.py runs them in the shells.

#include "core/cli/shell_completion.h"

#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::cli {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

ProgramDescription Server() {
  return {.name = "my-server",
          .summary = "Serves",
          .version = "1",
          .commands = {{.name = "",
                        .flags = {{.names = {"--level"},
                                   .value_name = "a|b",
                                   .help = "it's a [level]: low; or high",
                                   .choices = {"a", "b"}}}}}};
}

TEST(ShellFromNameTest, KnowsThree) {
  EXPECT_EQ(*ShellFromName("bash"), Shell::kBash);
  EXPECT_EQ(*ShellFromName("zsh"), Shell::kZsh);
  EXPECT_EQ(*ShellFromName("fish"), Shell::kFish);
  EXPECT_THAT(std::string(ShellFromName("ksh").status().message()), HasSubstr("bash, zsh or fish"));
}

TEST(CompletionScriptTest, AProgramWithoutCommandsHasNoWordsForThem) {
  for (const Shell shell : {Shell::kBash, Shell::kZsh, Shell::kFish}) {
    const std::string script = CompletionScript(shell, Server());
    EXPECT_THAT(script, HasSubstr("level"));
    EXPECT_THAT(script, Not(HasSubstr("help")));
  }
}

TEST(CompletionScriptTest, WordsWithAColonWaitForTheColon) {
  ProgramDescription program = Server();
  program.commands[0].flags[0].choices = {"z", "none", "z:grey"};
  EXPECT_THAT(CompletionScript(Shell::kBash, program), HasSubstr("words='z none z:grey'"));
  EXPECT_THAT(CompletionScript(Shell::kZsh, program),
              HasSubstr(":{ if [[ $PREFIX == *\\:* ]]; then compadd -- z\\:grey; "
                        "else compadd -S \"\" -- z; compadd -- none; fi }'"));
  EXPECT_THAT(CompletionScript(Shell::kFish, program),
              HasSubstr("-a '(__my_server_words z none z:grey)'"));
}

TEST(CompletionScriptTest, HelpIsQuotedForItsShell) {
  EXPECT_THAT(CompletionScript(Shell::kZsh, Server()),
              HasSubstr("'--level=[it'\\''s a \\[level\\]\\: low]:a|b:(a b)'"));
  EXPECT_THAT(CompletionScript(Shell::kFish, Server()),
              HasSubstr("-l level -a 'a b' -x -d 'it\\'s a [level]: low'"));
}

}  // namespace
}  // namespace isoscope::cli
