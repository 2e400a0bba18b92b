// Endpoints that change between two polls. The agents' answers are in agent_registry_test.

#include "server/cluster/agent_members.h"

#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::server {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::Key;

class AgentMembersTest : public ::testing::Test {
 protected:
  AgentMembers Resolve(AgentMembers members) { return resolver_.Resolve(std::move(members)); }

  std::vector<AgentEndpoint> endpoints_;
  absl::StatusOr<std::vector<std::string>> addresses_ = std::vector<std::string>{};
  std::string refused_;  // target
  AgentMemberResolver resolver_{endpoints_,
                                [this](const std::string& target) {
                                  return target == refused_ ? absl::InvalidArgumentError("refused")
                                                            : absl::OkStatus();
                                },
                                [this](const DnsName&) { return addresses_; }};
};

TEST_F(AgentMembersTest, APlainTargetIsOneMember) {
  endpoints_ = {{"host:1", nullptr}, {"host:2", nullptr}};
  const AgentMembers members = Resolve({});
  EXPECT_THAT(members, ElementsAre(Key("host:1"), Key("host:2")));
  EXPECT_EQ(members.at("host:2").endpoint_index, 1U);
  EXPECT_EQ(members.at("host:2").state.address, "host:2");
  EXPECT_FALSE(members.at("host:2").is_name);
}

TEST_F(AgentMembersTest, AnAddressThatANameHasLostStaysUnlisted) {
  endpoints_ = {{"host:1", nullptr}, {"dns:///agents:2", nullptr}};
  addresses_ = {"a:2", "b:2"};
  AgentMembers members = Resolve({});
  EXPECT_THAT(members, ElementsAre(Key("a:2"), Key("b:2"), Key("host:1")));
  addresses_ = {"b:2", "c:2"};
  members = Resolve(members);
  EXPECT_THAT(members, ElementsAre(Key("a:2"), Key("b:2"), Key("c:2"), Key("host:1")));
  EXPECT_FALSE(members.at("a:2").is_listed);
  EXPECT_TRUE(members.at("b:2").is_listed);
  EXPECT_TRUE(members.at("host:1").is_listed) << "of another endpoint";
  addresses_ = {"a:2"};
  EXPECT_TRUE(Resolve(members).at("a:2").is_listed) << "it is back";
}

TEST_F(AgentMembersTest, ANameThatCantBeResolvedIsAMemberUntilItHasAgents) {
  endpoints_ = {{"dns:///agents:2", nullptr}};
  addresses_ = absl::UnavailableError("no server");
  AgentMembers members = Resolve({});
  ASSERT_THAT(members, ElementsAre(Key("dns:///agents:2")));
  EXPECT_TRUE(members.begin()->second.is_name);
  EXPECT_THAT(members.begin()->second.state.status, StatusIs(absl::StatusCode::kUnavailable));
  addresses_ = {"a:2"};
  members = Resolve(members);
  EXPECT_THAT(members, ElementsAre(Key("a:2")));
  addresses_ = absl::UnavailableError("no server");
  members = Resolve(members);
  EXPECT_THAT(members, ElementsAre(Key("a:2")));
  EXPECT_TRUE(members.at("a:2").is_listed);
}

TEST_F(AgentMembersTest, AListIsReplacedAsAWholeOrNotAtAll) {
  const testing::TempDir directory;
  const std::string path = directory.Sub("agents");
  endpoints_ = {{"file:" + path, nullptr}, {"host:1", nullptr}};
  EXPECT_TRUE(Resolve({}).at("file:" + path).is_name);
  std::ofstream(path) << "a:1\nb:1\n";
  AgentMembers members = Resolve({});
  EXPECT_THAT(members, ElementsAre(Key("a:1"), Key("b:1"), Key("host:1")));
  std::ofstream(path) << "b:1\nc:1\n";
  members = Resolve(members);
  EXPECT_THAT(members, ElementsAre(Key("b:1"), Key("c:1"), Key("host:1")));
  std::ofstream(path) << "d:1\ne:1\n";
  refused_ = "e:1";
  EXPECT_THAT(Resolve(members), ElementsAre(Key("b:1"), Key("c:1"), Key("host:1")));
}

}  // namespace
}  // namespace isoscope::server
