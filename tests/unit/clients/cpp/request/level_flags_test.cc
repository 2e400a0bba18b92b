#include "clients/cpp/request/level_flags.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::client {
namespace {

using ::testing::HasSubstr;
using testing::IsOk;
using testing::StatusIs;

absl::Status Parse(const std::vector<std::string>& arguments, LevelFlags* flags) {
  cli::FlagSet set({.has_help = false});
  AddLevelFlags(&set, flags);
  const absl::Status status = set.Parse(arguments);
  return status.ok() ? CheckUsage(*flags) : status;
}

TEST(LevelFlagsTest, WithoutAFlagTheRequestHasNoChoice) {
  LevelFlags flags;
  ASSERT_THAT(Parse({}, &flags), IsOk());
  isoscope::v1::RenderIsosurfaceRequest request;
  SetLevel(flags, &request);
  EXPECT_EQ(request.SerializeAsString(), "");
}

TEST(LevelFlagsTest, EachFlagIsAChoice) {
  LevelFlags by_number;
  ASSERT_THAT(Parse({"--level", "0"}, &by_number), IsOk());
  isoscope::v1::RenderIsosurfaceRequest request;
  SetLevel(by_number, &request);
  EXPECT_EQ(request.level().choice_case(), isoscope::v1::LevelChoice::kLevel);
  EXPECT_EQ(request.level().level(), 0);
  LevelFlags by_spacing;
  ASSERT_THAT(Parse({"--max-spacing=1.1"}, &by_spacing), IsOk());
  SetLevel(by_spacing, &request);
  EXPECT_EQ(request.level().choice_case(), isoscope::v1::LevelChoice::kMaxSpacingPx);
  EXPECT_EQ(request.level().max_spacing_px(), 1.1);
}

TEST(LevelFlagsTest, WrongValuesAreUsageErrors) {
  for (const std::vector<std::string>& arguments : {std::vector<std::string>{"--level=24"},
                                                    {"--level=-1"},
                                                    {"--level=a"},
                                                    {"--max-spacing=0"},
                                                    {"--max-spacing=-1"},
                                                    {"--max-spacing=nan"},
                                                    {"--max-spacing=inf"}}) {
    LevelFlags flags;
    EXPECT_FALSE(Parse(arguments, &flags).ok()) << arguments[0];
  }
  LevelFlags flags;
  EXPECT_THAT(Parse({"--level=1", "--max-spacing=2"}, &flags),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("exclude each other")));
}

TEST(LevelFlagsTest, TheLevelIsToldWithTheSizeOfASample) {
  isoscope::v1::DrawnLevel drawn;
  EXPECT_EQ(TextOfLevel(drawn), "level 0 (exact)");
  drawn.set_level(2);
  drawn.set_max_spacing_px(0.9123);
  EXPECT_EQ(TextOfLevel(drawn), "level 2, 1 sample = 0.91 px");
}

}  // namespace
}  // namespace isoscope::client
