#include "clients/cpp/request/clip_flags.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/cli/usage.h"
#include "tests/support/status_matchers.h"

namespace isoscope::client {
namespace {

using ::testing::HasSubstr;

ClipFlags Parse(const std::vector<std::string>& arguments) {
  cli::FlagSet set;
  ClipFlags flags;
  AddClipFlags(&set, &flags);
  ISOSCOPE_EXPECT_OK(set.Parse(arguments));
  return flags;
}

TEST(ClipFlagsTest, PlanesAndBoxBecomeTheRegion) {
  EXPECT_TRUE(Parse({}).empty());
  const ClipFlags flags = Parse(
      {"--clip-plane", "1,0,-2,12.5", "--clip-plane", "0,1,0,-3", "--clip-box", "0,3,1,4,2,5"});
  EXPECT_FALSE(flags.empty());
  const isoscope::v1::ClipRegion region = ToProto(flags);
  ASSERT_EQ(region.half_spaces_size(), 2);
  EXPECT_EQ(region.half_spaces(0).normal().z(), -2);
  EXPECT_EQ(region.half_spaces(0).offset(), 12.5);
  EXPECT_EQ(region.half_spaces(1).normal().y(), 1);
  EXPECT_EQ(region.box().min().z(), 2);
  EXPECT_EQ(region.box().max().x(), 3);
  EXPECT_FALSE(ToProto(Parse({"--clip-plane", "1,0,0,0"})).has_box());
}

TEST(ClipFlagsTest, SevenPlanesAreTooMany) {
  ClipFlags flags;
  flags.planes.resize(6);
  EXPECT_TRUE(CheckUsage(flags).ok());
  flags.planes.resize(7);
  const absl::Status status = CheckUsage(flags);
  EXPECT_TRUE(cli::IsUsageError(status));
  EXPECT_THAT(std::string(status.message()), HasSubstr("--clip-plane is given 7 times"));
}

TEST(ClipFlagsTest, HelpSaysWhatIsDone) {
  cli::FlagSet set;
  ClipFlags flags;
  AddClipFlags(&set, &flags, "export");
  EXPECT_THAT(set.Help(), HasSubstr("export only the points p"));
}

}  // namespace
}  // namespace isoscope::client
