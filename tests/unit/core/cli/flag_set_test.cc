// One set with a flag of every kind (FlagSetTest) is parsed from many command lines:
//
// - values of every kind of flag, from arguments and from the environment;
// - the message of every error, which is part of the interface;
// - the text of --help and --version, and the descriptions for completions and man pages.

#include "core/cli/flag_set.h"

#include <cstdlib>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/cli/usage.h"
#include "tests/support/status_matchers.h"

namespace isoscope::cli {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

// Flags of every kind, with the variables that they are read into.
class FlagSetTest : public ::testing::Test {
 protected:
  explicit FlagSetTest(const FlagSetOptions& options = {.names_nearest_flag = true})
      : set_(options) {
    const auto add_text = [this](absl::string_view text) {
      texts_.emplace_back(text);
      return text == "bad" ? absl::InvalidArgumentError("'bad' is bad") : absl::OkStatus();
    };
    set_.AddText("input", "INPUT|DIR", &input_, "a volume");
    set_.Add("--output,-o", "FILE.png", add_text, "the picture").Group("Files");
    set_.AddOptional("--caps", "[MAP]", add_text, "fill the cuts");
    set_.AddList("--list", "V", add_text, "values");
    set_.AddRepeatable("--repeated", "V", add_text, "a value");
    set_.AddTexts("--agent", "TARGET", &agents_, "an agent", /*splits_at_spaces=*/true)
        .Environment("FLAG_SET_TEST_AGENT");
    set_.AddChoice("--level", &level_, {"low", "high"}, "how high");
    set_.AddInteger("--count", &count_, 1, 9, "how many");
    set_.AddNumber("--seconds", &seconds_, 0.5, 10, "how long")
        .Environment("FLAG_SET_TEST_SECONDS");
    set_.AddByteSize("--memory", &bytes_, 1024, 1e12, "how much");
    const Flag json = set_.AddSwitch("--json", &is_json_, "print JSON");
    const Flag text = set_.AddSwitch("--text", &is_text_, "print text");
    const Flag table = set_.AddSwitch("--table", &is_table_, "print a table");
    set_.Exclude(json, table);
    set_.Exclude(json, text);
  }

  // The message of the error, which must be wrong usage.
  std::string ErrorOf(const std::vector<std::string>& arguments) {
    const absl::Status status = set_.Parse(arguments);
    EXPECT_TRUE(IsUsageError(status)) << status;
    return std::string(status.message());
  }

  FlagSet set_;
  std::string input_;
  std::vector<std::string> texts_;
  std::vector<std::string> agents_;
  std::string level_ = "low";
  int count_ = 3;
  double seconds_ = 1.5;
  std::int64_t bytes_ = 2048;
  bool is_json_ = false;
  bool is_text_ = false;
  bool is_table_ = false;
};

TEST_F(FlagSetTest, DefaultsStayWithoutFlags) {
  ISOSCOPE_ASSERT_OK(set_.Parse({}));
  EXPECT_EQ(set_.requested_text(), "");
  EXPECT_THAT(set_.GivenNames(), IsEmpty());
  EXPECT_THAT(texts_, IsEmpty());
  EXPECT_EQ(level_, "low");
  EXPECT_EQ(count_, 3);
  EXPECT_EQ(seconds_, 1.5);
  EXPECT_EQ(bytes_, 2048);
  EXPECT_FALSE(is_json_);
}

TEST_F(FlagSetTest, EveryKindOfFlagIsRead) {
  ISOSCOPE_ASSERT_OK(set_.Parse(
      {"in.nrrd",    "-o",          "a.png",        "--list",       "1,2",     "3",
       "--repeated", "4",           "--caps",       "--repeated=5", "--agent", "a:1",
       "b:2",        "--agent=c d", "--level=high", "--count",      "9",       "--seconds",
       "2",          "--memory",    "4KiB",         "--json"}));
  EXPECT_EQ(input_, "in.nrrd");
  // Each text once; flags in the order of their declaration.
  EXPECT_THAT(texts_, ElementsAre("a.png", "", "1", "2", "3", "4", "5"));
  EXPECT_THAT(agents_, ElementsAre("a:1", "b:2", "c", "d"));
  EXPECT_EQ(level_, "high");
  EXPECT_EQ(count_, 9);
  EXPECT_EQ(seconds_, 2);
  EXPECT_EQ(bytes_, 4096);
  EXPECT_TRUE(is_json_);
  EXPECT_THAT(set_.GivenNames(), ElementsAre("input", "output", "caps", "list", "repeated", "agent",
                                             "level", "count", "seconds", "memory", "json"));
}

TEST_F(FlagSetTest, ASwitchCanBeUnset) {
  is_json_ = true;
  ISOSCOPE_ASSERT_OK(set_.Parse({"--json=false"}));
  EXPECT_FALSE(is_json_);
}

TEST_F(FlagSetTest, AnUnknownFlagIsNamedWithTheNearestOne) {
  EXPECT_EQ(ErrorOf({"--ouput=a.png"}), "unknown flag --ouput; did you mean --output?");
}

TEST_F(FlagSetTest, NothingIsNearToSomeFlags) {
  EXPECT_EQ(ErrorOf({"--zzzzzzzz"}), "unknown flag --zzzzzzzz");
}

TEST_F(FlagSetTest, OneArgumentTooManyIsNamed) {
  EXPECT_EQ(ErrorOf({"a", "b"}), "'b' is one argument too many");
}

TEST_F(FlagSetTest, AMissingValueIsNamed) {
  EXPECT_EQ(ErrorOf({"--output"}), "--output: 1 required FILE.png missing");
}

TEST_F(FlagSetTest, ASecondValueIsRefused) {
  EXPECT_EQ(ErrorOf({"--output", "a", "--output", "b"}),
            "--output: At Most 1 required but received 2");
}

TEST_F(FlagSetTest, AWrongValueComesBeforeASecondOne) {
  EXPECT_EQ(ErrorOf({"--output", "a", "--output", "bad"}), "--output: 'bad' is bad");
}

TEST_F(FlagSetTest, AWrongChoiceIsNamedWithAll) {
  EXPECT_EQ(ErrorOf({"--level", "mid"}), "--level: mid not in {low,high}");
}

TEST_F(FlagSetTest, IntegersHaveARange) {
  EXPECT_EQ(ErrorOf({"--count", "10"}), "--count: Value 10 not in range 1 to 9");
}

TEST_F(FlagSetTest, NumbersHaveARange) {
  EXPECT_THAT(ErrorOf({"--seconds", "x"}), HasSubstr("--seconds: Value x not in range 0.5"));
}

TEST_F(FlagSetTest, SizesHaveARange) {
  EXPECT_THAT(ErrorOf({"--memory", "1"}), HasSubstr("--memory: Value 1 not in range 1024"));
}

TEST_F(FlagSetTest, ExcludedFlagsAreNamed) {
  EXPECT_EQ(ErrorOf({"--text", "--json"}), "--json excludes --text");
}

TEST_F(FlagSetTest, TheFirstExclusionIsNamedOfTwo) {
  EXPECT_EQ(ErrorOf({"--text", "--table", "--json"}), "--json excludes --table");
}

TEST_F(FlagSetTest, HelpNamesExclusionsInTheirOrder) {
  EXPECT_THAT(set_.Help(), HasSubstr("--json Excludes: --table --text\n"));
  EXPECT_THAT(set_.Help(), HasSubstr("--text Excludes: --json "));
}

TEST_F(FlagSetTest, TheEnvironmentHasWhatIsNotGiven) {
  // NOLINTBEGIN(concurrency-mt-unsafe): one thread
  setenv("FLAG_SET_TEST_AGENT", "a:1 b:2", 1);
  setenv("FLAG_SET_TEST_SECONDS", "4", 1);
  ISOSCOPE_ASSERT_OK(set_.Parse({"--seconds", "3"}));
  unsetenv("FLAG_SET_TEST_AGENT");
  unsetenv("FLAG_SET_TEST_SECONDS");
  // NOLINTEND(concurrency-mt-unsafe)
  EXPECT_THAT(agents_, ElementsAre("a:1", "b:2"));
  EXPECT_EQ(seconds_, 3);
}

TEST_F(FlagSetTest, ARemovedFlagIsUnknown) {
  set_.Remove("--caps");
  EXPECT_EQ(ErrorOf({"--caps=a"}), "unknown flag --caps");
}

TEST_F(FlagSetTest, DescriptionsSayWhatHelpSays) {
  const std::vector<FlagDescription> flags = set_.Describe();
  ASSERT_EQ(flags.size(), 14);  // and --help
  EXPECT_THAT(flags[0].names, ElementsAre("--help", "-h"));
  EXPECT_EQ(flags[0].value_name, "");
  EXPECT_THAT(flags[1].names, IsEmpty());
  EXPECT_TRUE(flags[1].takes_files && flags[1].takes_folders);
  EXPECT_THAT(flags[2].names, ElementsAre("--output", "-o"));
  EXPECT_EQ(flags[2].value_name, "FILE.png");
  EXPECT_EQ(flags[2].group, "Files");
  EXPECT_TRUE(flags[2].takes_files && !flags[2].has_optional_value && !flags[2].is_repeatable);
  EXPECT_TRUE(flags[3].has_optional_value);
  EXPECT_TRUE(flags[4].is_repeatable);
  EXPECT_TRUE(flags[5].is_repeatable);
  EXPECT_EQ(flags[6].environment, "FLAG_SET_TEST_AGENT");
  EXPECT_EQ(flags[7].value_name, "TEXT:{low,high}");
  EXPECT_EQ(flags[7].default_value, "low");
  EXPECT_THAT(flags[7].choices, ElementsAre("low", "high"));
  EXPECT_EQ(flags[8].default_value, "3");
  EXPECT_EQ(flags[9].default_value, "1.5");
  EXPECT_EQ(flags[11].value_name, "");
  EXPECT_EQ(flags[11].help, "print JSON");
}

class ServiceFlagSetTest : public FlagSetTest {
 protected:
  ServiceFlagSetTest()
      : FlagSetTest(
            {.name = "tool", .summary = "Serves", .notes = "The end", .version = "tool 1"}) {}
};

TEST_F(ServiceFlagSetTest, HelpHasUsageFlagsAndNotes) {
  ISOSCOPE_ASSERT_OK(set_.Parse({"--help", "--unknown"}));
  EXPECT_EQ(set_.requested_text(), set_.Help());
  EXPECT_THAT(set_.Help(),
              ::testing::AllOf(HasSubstr("Serves\nUsage: tool [OPTIONS] [input]\n"),
                               HasSubstr("  -o,--output FILE.png        the picture\n"),
                               HasSubstr("\nFiles:\n"), HasSubstr("(Env:FLAG_SET_TEST_AGENT)"),
                               HasSubstr("--count INT:INT in [1 - 9]=3"), HasSubstr("The end\n")));
}

TEST_F(ServiceFlagSetTest, VersionIsOneLine) {
  ISOSCOPE_ASSERT_OK(set_.Parse({"--version"}));
  EXPECT_EQ(set_.requested_text(), "tool 1\n");
}

TEST_F(ServiceFlagSetTest, UnexpectedArgumentsAreListed) {
  EXPECT_EQ(ErrorOf({"a", "b", "--unknown"}),
            "The following arguments were not expected: --unknown b");
}

TEST_F(ServiceFlagSetTest, TwoDashesBeginPositionalArguments) {
  ISOSCOPE_ASSERT_OK(set_.Parse({"--", "--json"}));
  EXPECT_EQ(input_, "--json");
  EXPECT_FALSE(is_json_);
}

TEST(FlagSetOptionsTest, ACommandHasItsOwnUsage) {
  const FlagSet set({.summary = "Renders", .usage = "tool render INPUT"});
  EXPECT_THAT(set.Help(), HasSubstr("Renders\n\nUsage: tool render INPUT\n"));
}

TEST(FlagSetOptionsTest, HelpCanBeLeftOut) {
  FlagSet set({.has_help = false});
  EXPECT_THAT(set.Describe(), IsEmpty());
  EXPECT_TRUE(IsUsageError(set.Parse({"--help"})));
}

}  // namespace
}  // namespace isoscope::cli
