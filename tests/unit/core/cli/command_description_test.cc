#include "core/cli/command_description.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

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

TEST(SetValueNameTest, TellsFilesAndFolders) {
  FlagDescription flag;
  SetValueName("INPUT|DIR", &flag);
  EXPECT_EQ(flag.value_name, "INPUT|DIR");
  EXPECT_TRUE(flag.takes_files && flag.takes_folders);
  SetValueName("FILE.png", &flag);
  EXPECT_TRUE(flag.takes_files && !flag.takes_folders);
  SetValueName("DIR", &flag);
  EXPECT_TRUE(flag.takes_folders && !flag.takes_files);
  SetValueName("a|b", &flag);
  EXPECT_THAT(flag.choices, ElementsAre("a", "b"));
}

}  // namespace
}  // namespace isoscope::cli
