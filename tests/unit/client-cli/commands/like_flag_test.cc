// `render --like` against the flags of `render`.

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "client-cli/commands/program.h"
#include "clients/cpp/connection/like_picture.h"
#include "core/cli/flag_set.h"
#include "core/cli/usage.h"
#include "tests/support/status_matchers.h"

namespace isoscope::cli {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

// A new flag of `render` is refused with --like by default, not ignored.
TEST(LikeFlagTest, FlagsThatDecideAPixelAreRefused) {
  const auto check = [](const std::vector<std::string>& arguments) {
    FlagSet set;
    const Action owner_of_values = RenderCommand().register_flags(&set);
    ISOSCOPE_EXPECT_OK(set.Parse(arguments));
    return client::CheckOnlyFlagsBesideLike(set);
  };
  ISOSCOPE_EXPECT_OK(check({"v.nrrd", "--like", "a.png", "--output", "b.png", "--shards", "3",
                            "--culling", "none", "--renderer", "cpu", "--no-metadata"}));
  for (const std::vector<std::string>& flag :
       std::vector<std::vector<std::string>>{{"--isovalue", "3"},
                                             {"--width", "3"},
                                             {"--color", "1,1,1"},
                                             {"--background", "1,1,1,0"},
                                             {"--azimuth", "3"},
                                             {"--eye", "1,2,3"},
                                             {"--surface", "3:1,0,0"},
                                             {"--clip-plane", "1,0,0,3"},
                                             {"--clip-box", "0,1,0,1,0,1"},
                                             {"--region", "0,0,3,3"},
                                             {"--view", "left"},
                                             {"--fit", "surface"},
                                             {"--depth", "d.npy"},
                                             {"--samples", "4"},
                                             {"--ambient-occlusion"},
                                             {"--silhouette", "3"},
                                             {"--level", "2"},
                                             {"--max-spacing", "1.1"},
                                             {"--repeat", "3"},
                                             {"--fps", "3"}}) {
    std::vector<std::string> arguments{"v.nrrd", "--like", "a.png"};
    arguments.insert(arguments.end(), flag.begin(), flag.end());
    const absl::Status status = check(arguments);
    EXPECT_TRUE(IsUsageError(status)) << flag[0];
    EXPECT_THAT(std::string(status.message()), HasSubstr(flag[0]));
  }
}

}  // namespace
}  // namespace isoscope::cli
