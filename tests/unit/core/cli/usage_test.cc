#include "core/cli/usage.h"

#include "gtest/gtest.h"

namespace isoscope::cli {
namespace {

TEST(UsageTest, ExitCodesSeparateWrongUsageFromFailedRequests) {
  EXPECT_EQ(ExitCodeOf(absl::OkStatus()), 0);
  EXPECT_EQ(ExitCodeOf(absl::InvalidArgumentError("a request that can't be right")), 1);
  EXPECT_EQ(ExitCodeOf(absl::NotFoundError("no file")), 1);
  EXPECT_EQ(ExitCodeOf(UsageError("--width is odd")), 2);
}

TEST(UsageTest, RefusalsOfLibrariesBecomeWrongUsage) {
  const absl::Status refused = AsUsageError(absl::InvalidArgumentError("STL has no colours"));
  EXPECT_TRUE(IsUsageError(refused));
  EXPECT_EQ(refused.message(), "STL has no colours");
  EXPECT_TRUE(AsUsageError(absl::OkStatus()).ok());
  EXPECT_EQ(AsUsageError(absl::NotFoundError("no file")), absl::NotFoundError("no file"));
}

TEST(UsageTest, ErrorsAreOneLineThatNamesTheCode) {
  EXPECT_EQ(FormatError("isoscope", "render", absl::DataLossError("block 7\nof shard 1")),
            "isoscope: DATA_LOSS: block 7; of shard 1");
  EXPECT_EQ(FormatError("isoscope", "render", UsageError("--zoom: 'a' is bad")),
            "isoscope render: --zoom: 'a' is bad (see 'isoscope render --help')");
  EXPECT_EQ(FormatError("isoscope", "", UsageError("a command is missing")),
            "isoscope: a command is missing (see 'isoscope --help')");
}

TEST(UsageTest, ErrorsOfServersDoNotSteerTheTerminal) {
  EXPECT_EQ(FormatError("isoscope", "render",
                        absl::NotFoundError("\x1b]0;mine\x07\x1b[2J\r\n\u009b31mhead\xff")),
            "isoscope: NOT_FOUND: ?]0;mine??[2J; ?31mhead?");
  EXPECT_EQ(FormatError("isoscope", "render", UsageError("'\x1b[1m' is one argument too many")),
            "isoscope render: '?[1m' is one argument too many (see 'isoscope render --help')");
}

TEST(UsageTest, NearestNameFindsTyposOnly) {
  const std::vector<std::string> names = {"partition", "info", "serve", "render", "export"};
  EXPECT_EQ(NearestName("rendr", names), "render");
  EXPECT_EQ(NearestName("inf", names), "info");
  EXPECT_EQ(NearestName("partiton", names), "partition");
  EXPECT_EQ(NearestName("zzzzzz", names), "");
  EXPECT_EQ(NearestName("x", {}), "");
  EXPECT_EQ(NearestName("q", {"p", "u"}), "") << "all of its letters are wrong";
  EXPECT_EQ(NearestName("prtitin", names), "partition") << "a third of the letters may be wrong";
  const std::string long_name(256, 'a');
  EXPECT_EQ(NearestName(long_name, {long_name + "b"}), long_name + "b");
  EXPECT_EQ(NearestName(long_name + "a", {long_name}), "") << "a stranger may send any length";
}

}  // namespace
}  // namespace isoscope::cli
