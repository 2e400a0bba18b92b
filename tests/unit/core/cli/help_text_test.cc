#include "core/cli/help_text.h"

#include <algorithm>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::cli {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

HelpLayout Layout() {
  return {.headings = {{"Input", {"--server"}}, {"Output", {"--output"}}, {"Lights", {}}},
          .common = {{"draw", {"INPUT", "--output", "--help"}}}};
}

CommandDescription Draw() {
  CommandDescription command{
      .name = "draw",
      .summary = "Draws a picture of what there is",
      .usage = "INPUT [OPTIONS]",
      .examples = "  tool draw a.nrrd --output a.png\n",
      .flags = {{.names = {"--help", "-h"},
                 .has_optional_value = true,  // as of any switch
                 .help = "this text",
                 .group = "Options"},
                {.names = {"--light"},
                 .value_name = "X,Y,Z",
                 .is_repeatable = true,
                 .help = "a light",
                 .group = "Lights"},
                {.names = {"--output", "-o"},
                 .value_name = "FILE.png",
                 .help = "the picture, whose name has to be long enough here for a second line",
                 .group = "Options"},
                {.value_name = "INPUT", .help = "a volume", .group = "Options"},
                {.names = {"--server"},
                 .value_name = "HOST",
                 .help = "who is asked",
                 .group = "Options",
                 .environment = "TOOL_SERVER",
                 .default_value = "here"},
                {.names = {"--caps"},
                 .value_name = "[MAP[:MIN,MAX]]",
                 .has_optional_value = true,
                 .help = "fill cuts",
                 .group = "Options"}}};
  Arrange(Layout(), &command);
  return command;
}

std::string Help(HelpPart part, int columns = 0) {
  return HelpText("tool", Draw(), Layout(), part, columns);
}

std::vector<std::string> KeysOf(const CommandDescription& command) {
  std::vector<std::string> keys;
  for (const FlagDescription& flag : command.flags) {
    keys.push_back(KeyOf(flag));
  }
  return keys;
}

std::size_t LongestLine(const std::string& text) {
  std::size_t longest = 0;
  for (const absl::string_view line : absl::StrSplit(text, '\n')) {
    longest = std::max(longest, line.size());
  }
  return longest;
}

TEST(ArrangeTest, FlagsStandInTheOrderOfTheHeadings) {
  EXPECT_THAT(KeysOf(Draw()),
              ElementsAre("INPUT", "--server", "--output", "--light", "--help", "--caps"));
}

TEST(ArrangeTest, FlagsOfAHeadingStandInItsOrder) {
  CommandDescription command;
  for (const char* name : {"--c", "--b", "--other", "--a"}) {
    command.flags.push_back({.names = {name}, .group = "Options"});
  }
  command.flags[2].group = "All";
  Arrange({.headings = {{"All", {"--a", "--b", "--c"}}}}, &command);
  EXPECT_THAT(KeysOf(command), ElementsAre("--a", "--b", "--c", "--other"));
}

TEST(ArrangeTest, ArgumentsStandFirstWithoutALayoutToo) {
  CommandDescription command;
  command.flags = {{.names = {"--a"}, .group = "Options"},
                   {.value_name = "INPUT", .group = "Options"},
                   {.names = {"--b"}, .group = "Options"}};
  Arrange({}, &command);
  EXPECT_THAT(KeysOf(command), ElementsAre("INPUT", "--a", "--b"));
}

TEST(ArrangeTest, ADeclaredHeadingStays) {
  EXPECT_EQ(Draw().flags[3].group, "Lights");
  EXPECT_EQ(Draw().flags[1].group, "Input");
  EXPECT_EQ(Draw().flags[5].group, "Options") << "the layout does not know --caps";
}

TEST(ArrangeTest, HeadingsThatNoLayoutKnowsStayTogether) {
  CommandDescription command;
  for (const char* group : {"A", "B", "A"}) {
    command.flags.push_back({.names = {"--x"}, .group = group});
  }
  Arrange({}, &command);
  EXPECT_EQ(command.flags[1].group, "A");
  EXPECT_EQ(command.flags[2].group, "B");
}

TEST(HelpTextTest, TheWholeTextInKnownBytes) {
  EXPECT_EQ(Help(HelpPart::kAll),
            "Draws a picture of what there is\n"
            "\n"
            "Usage: tool draw INPUT [OPTIONS]\n"
            "\n"
            "Input:\n"
            "  INPUT                     a volume\n"
            "  --server HOST             who is asked (default: here) (or $TOOL_SERVER)\n"
            "\n"
            "Output:\n"
            "  -o, --output FILE.png     the picture, whose name has to be long enough here\n"
            "                            for a second line\n"
            "\n"
            "Lights:\n"
            "  --light X,Y,Z ...         a light\n"
            "\n"
            "Options:\n"
            "  -h, --help                this text\n"
            "  --caps[=MAP[:MIN,MAX]]    fill cuts\n"
            "\n"
            "Examples:\n"
            "  tool draw a.nrrd --output a.png\n");
}

TEST(HelpTextTest, TheCommonPartSaysWhatItLeavesOut) {
  const std::string text = Help(HelpPart::kCommon);
  EXPECT_THAT(text, HasSubstr("--output"));
  EXPECT_THAT(text, HasSubstr("INPUT    "));
  EXPECT_THAT(text, Not(HasSubstr("--light ")));
  EXPECT_THAT(text, Not(HasSubstr("\nLights:")));
  EXPECT_THAT(text, HasSubstr("\n--help-all lists 3 more: Input, Lights, Options\n"));
}

TEST(HelpTextTest, ACommandWithoutCommonFlagsShowsAll) {
  CommandDescription command = Draw();
  command.name = "other";
  const std::string text = HelpText("tool", command, Layout(), HelpPart::kCommon, 0);
  EXPECT_THAT(text, HasSubstr("--light "));
  EXPECT_THAT(text, Not(HasSubstr("--help-all")));
}

TEST(HelpTextTest, LinesKeepToTheWidth) {
  for (const int columns : {40, 60, 80, 100}) {
    EXPECT_LE(LongestLine(Help(HelpPart::kAll, columns)), static_cast<std::size_t>(columns));
  }
  EXPECT_EQ(Help(HelpPart::kAll, 0), Help(HelpPart::kAll, 80));
  EXPECT_EQ(Help(HelpPart::kAll, 5), Help(HelpPart::kAll, 40)) << "no line is narrower";
}

TEST(HelpEntryTest, ALongNameHasALineOfItsOwn) {
  EXPECT_EQ(HelpEntry("short", "text", 10, 40), "  short   text\n");
  EXPECT_EQ(HelpEntry("shorter", "text", 10, 40), "  shorter\n          text\n");
  EXPECT_EQ(HelpEntry("alone", "", 10, 40), "  alone\n");
}

TEST(HelpEntryTest, AWordThatIsLongerThanTheLineStaysWhole) {
  const std::string word(60, 'w');
  EXPECT_TRUE(absl::StrContains(HelpEntry("a", "b " + word + " c", 10, 40), word));
}

TEST(AddWordsTest, WordsGoToTheValuesOfThatName) {
  CommandDescription command;
  command.flags = {{.names = {"--format"}, .value_name = "NAME"},
                   {.names = {"--color-by"}, .value_name = "x|y", .choices = {"x", "y"}}};
  AddWords({{"--format", "NAME", {"nrrd"}}, {"--color-by", "", {"x", "x:grey"}}}, &command);
  EXPECT_THAT(command.flags[0].choices, ElementsAre("nrrd"));
  EXPECT_THAT(command.flags[1].choices, ElementsAre("x", "y", "x:grey"));
  command.flags = {{.names = {"--format"}, .value_name = "ply|stl", .choices = {"ply", "stl"}}};
  AddWords({{"--format", "NAME", {"nrrd"}}}, &command);
  EXPECT_THAT(command.flags[0].choices, ElementsAre("ply", "stl"));
}

}  // namespace
}  // namespace isoscope::cli
