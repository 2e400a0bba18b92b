#include "client-cli/session/level_flags.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::cli {
namespace {

using ::isoscope::testing::StatusIs;
using partition::LevelOptions;
using ::testing::HasSubstr;

LevelFlags Parsed(const std::vector<std::string>& arguments) {
  LevelFlags flags;
  FlagSet set;
  AddLevelFlags(&set, &flags);
  EXPECT_THAT(set.Parse(arguments), testing::IsOk());
  return flags;
}

TEST(LevelFlagsTest, LevelsAreANumberOrAWord) {
  EXPECT_EQ(LevelOptionsOf(Parsed({})).highest, LevelOptions::kAuto);
  EXPECT_EQ(LevelOptionsOf(Parsed({"--levels", "auto"})).highest, LevelOptions::kAuto);
  EXPECT_EQ(LevelOptionsOf(Parsed({"--levels", "none"})).highest, 0);
  EXPECT_EQ(LevelOptionsOf(Parsed({"--levels", "0"})).highest, 0);
  EXPECT_EQ(LevelOptionsOf(Parsed({"--levels", "5"})).highest, 5);
  for (const char* text : {"", "-1", "24", "1.5", "Auto"}) {
    EXPECT_THAT(ParseLevels(text),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("neither auto, none nor")))
        << text;
  }
}

TEST(LevelFlagsTest, TheFilterIsLeftToTheDataUnlessLabelsAreAskedFor) {
  EXPECT_FALSE(LevelOptionsOf(Parsed({})).filter.has_value());
  EXPECT_EQ(LevelOptionsOf(Parsed({"--label-levels"})).filter, volume::LevelFilter::kMajority);
}

TEST(LevelFlagsTest, TheFirstGivenIsNamed) {
  EXPECT_EQ(Parsed({}).FirstGiven(), nullptr);
  EXPECT_STREQ(Parsed({"--label-levels"}).FirstGiven(), "--label-levels");
  EXPECT_STREQ(Parsed({"--label-levels", "--levels", "1"}).FirstGiven(), "--levels");
}

}  // namespace
}  // namespace isoscope::cli
