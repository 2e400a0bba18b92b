#include "core/cli/command_description.h"

#include <optional>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <CLI/CLI.hpp>

namespace isoscope::cli {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

TEST(ChoicesOfTest, AreTheWordsThatMeanThemselves) {
  EXPECT_THAT(ChoicesOf("depth|mask|none"), ElementsAre("depth", "mask", "none"));
  EXPECT_THAT(ChoicesOf("1|4|9|16"), ElementsAre("1", "4", "9", "16"));
  EXPECT_THAT(ChoicesOf("x|y|z|gradient[:MAP[:MIN,MAX]]"), ElementsAre("x", "y", "z", "gradient"));
  EXPECT_THAT(ChoicesOf("TEXT:{auto,egl,cpu}"), ElementsAre("auto", "egl", "cpu"));
  EXPECT_THAT(ChoicesOf("V|auto"), ElementsAre("auto"));
  for (const char* none : {"", "FILE", "FILE|-", "HOST:PORT", "N|NXxNYxNZ", "INPUT|DIR", "text"}) {
    EXPECT_THAT(ChoicesOf(none), IsEmpty()) << none;
  }
}

TEST(DescribeFlagsTest, SaysWhatHelpSays) {
  CLI::App app("test");
  std::string text;
  std::string other;
  std::vector<std::string> list;
  bool is_set = false;
  app.add_option("input", text, "a volume")->type_name("INPUT|DIR");
  app.add_option("--output,-o", text, "the picture")->type_name("FILE.png")->group("Files");
  app.add_option("--folder", text, "")->type_name("DIR")->envname("FOLDER");
  app.add_option("--caps", other, "")->type_name("[MAP]")->expected(0, 1);
  app.add_option("--many", list, "")->type_name("V");
  app.add_option("--hidden", other, "")->group("");
  app.add_flag("--json", is_set, "print JSON");
  const std::vector<FlagDescription> flags = DescribeFlags(app);
  ASSERT_EQ(flags.size(), 7);  // and --help
  EXPECT_THAT(flags[0].names, ElementsAre("--help", "-h"));
  EXPECT_EQ(flags[0].value_name, "");
  EXPECT_THAT(flags[1].names, IsEmpty());
  EXPECT_TRUE(flags[1].takes_files && flags[1].takes_folders);
  EXPECT_THAT(flags[2].names, ElementsAre("--output", "-o"));
  EXPECT_EQ(flags[2].value_name, "FILE.png");
  EXPECT_EQ(flags[2].group, "Files");
  EXPECT_TRUE(flags[2].takes_files && !flags[2].takes_folders && !flags[2].has_optional_value);
  EXPECT_TRUE(flags[3].takes_folders && !flags[3].takes_files);
  EXPECT_EQ(flags[3].environment, "FOLDER");
  EXPECT_TRUE(flags[4].has_optional_value);
  EXPECT_TRUE(flags[5].is_repeatable);
  EXPECT_EQ(flags[6].value_name, "");
  EXPECT_EQ(flags[6].help, "print JSON");
}

}  // namespace
}  // namespace isoscope::cli
