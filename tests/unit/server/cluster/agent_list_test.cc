#include "server/cluster/agent_list.h"

#include <fstream>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::server {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::StatusIs;

class AgentListTest : public ::testing::Test {
 protected:
  absl::StatusOr<std::vector<std::string>> Read(const std::string& text) {
    std::ofstream(directory_.Sub("agents")) << text;
    return ReadAgentList(directory_.Sub("agents"));
  }

  testing::TempDir directory_;
};

TEST_F(AgentListTest, OnlyFileTargetsAreLists) {
  for (const char* other :
       {"localhost:50052", "dns:///agents:50052", "unix:/run/agent", "profile:1"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto path, ParseAgentListTarget(other));
    EXPECT_FALSE(path.has_value()) << other;
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto path, ParseAgentListTarget("file:/etc/agents"));
  EXPECT_EQ(path, "/etc/agents");
  EXPECT_THAT(ParseAgentListTarget("file:"), StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST_F(AgentListTest, LinesAreTargetsAndCommentsAreNot) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto targets, Read("# shard 0\n  node1:50052\nnode0:50052 # old\r\n\nnode1:50052"));
  EXPECT_THAT(targets, ElementsAre("node0:50052", "node1:50052"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto host, Read("node2\n"));
  EXPECT_THAT(host, ElementsAre("node2:50052"));
  EXPECT_THAT(Read("# nobody yet\n"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("names no agent")));
}

TEST_F(AgentListTest, ALineThatIsNoAgentIsNamed) {
  for (const char* bad : {"a:1 b:1", "dns:///agents:50052", "file:/other"}) {
    EXPECT_THAT(
        Read(std::string("a:1\n") + bad),
        StatusIs(absl::StatusCode::kInvalidArgument, AllOf(HasSubstr("line 2"), HasSubstr(bad))));
  }
  EXPECT_THAT(ReadAgentList(directory_.Sub("none")), StatusIs(absl::StatusCode::kNotFound));
}

}  // namespace
}  // namespace isoscope::server
