#include "server/agent_registry.h"

#include <atomic>
#include <memory>
#include <string>
#include <vector>

#include "absl/time/clock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/unit/server/fake_agent.h"

namespace isoscope::server {
namespace {

using ::testing::AllOf;
using testing::FakeAgent;
using ::testing::HasSubstr;
using testing::IsOk;
using testing::MakeShard;
using testing::StatusIs;

constexpr char kOtherId[] = "ffffffffffffffffffffffffffffffff";

AgentState Answering(const std::string& address,
                     std::vector<isoscope::internal::v1::ShardDescription> shards) {
  AgentState state;
  state.address = address;
  state.status = absl::OkStatus();
  state.shards = std::move(shards);
  return state;
}

TEST(DatasetsOfTest, ShardsAreGroupedByAgentInOrderOfFirstShards) {
  const auto datasets =
      DatasetsOf({Answering("a:1", {MakeShard("head", 1, 3)}),
                  Answering("b:1", {MakeShard("head", 0, 3), MakeShard("head", 2, 3)})});
  const DatasetState& head = datasets.at("head");
  ASSERT_THAT(head.status, IsOk());
  ASSERT_EQ(head.agents.size(), 2u);
  EXPECT_EQ(head.agents[0].address, "b:1");
  EXPECT_EQ(head.agents[0].shard_indices, std::vector<int>({0, 2}));
  EXPECT_EQ(head.agents[1].shard_indices, std::vector<int>({1}));
  EXPECT_EQ(head.dataset.missing_shards_size(), 0);
}

TEST(DatasetsOfTest, MissingShardsAndUnreachableAgentsAreNamed) {
  AgentState lost = Answering("b:1", {MakeShard("head", 1, 3)});
  lost.status = absl::UnavailableError("connection refused");
  const auto datasets = DatasetsOf({Answering("a:1", {MakeShard("head", 0, 3)}), lost});
  const DatasetState& head = datasets.at("head");
  EXPECT_THAT(head.status, StatusIs(absl::StatusCode::kFailedPrecondition,
                                    AllOf(HasSubstr("shards 1, 2 of 3"), HasSubstr("b:1"),
                                          HasSubstr("connection refused"))));
  EXPECT_TRUE(head.is_served);
  ASSERT_EQ(head.dataset.missing_shards_size(), 2);
  EXPECT_EQ(head.dataset.missing_shards(0), 1);
}

TEST(DatasetsOfTest, ADatasetWhoseAgentsAreAllLostIsStillKnown) {
  AgentState lost = Answering("b:1", {MakeShard("head", 0, 1)});
  lost.status = absl::UnavailableError("gone");
  const auto datasets = DatasetsOf({lost});
  EXPECT_FALSE(datasets.at("head").is_served);
  EXPECT_THAT(datasets.at("head").status, StatusIs(absl::StatusCode::kFailedPrecondition));
}

TEST(DatasetsOfTest, ContradictoryAgentsAreBothNamedWithTheirValues) {
  const auto datasets = DatasetsOf({Answering("a:1", {MakeShard("head", 0, 2)}),
                                    Answering("b:1", {MakeShard("head", 1, 2, kOtherId)})});
  EXPECT_THAT(datasets.at("head").status,
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       AllOf(HasSubstr("a:1"), HasSubstr("b:1"), HasSubstr(testing::kSomeId),
                             HasSubstr(kOtherId))));
  EXPECT_EQ(datasets.at("head").dataset.missing_shards_size(), 2);
}

TEST(DatasetsOfTest, DifferentChecksumsUnderOneIdContradict) {
  isoscope::internal::v1::ShardDescription other = MakeShard("head", 1, 2);
  other.set_range_table_crc32c(0xdead);
  const auto datasets =
      DatasetsOf({Answering("a:1", {MakeShard("head", 0, 2)}), Answering("b:1", {other})});
  EXPECT_THAT(datasets.at("head").status,
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("0000dead")));
}

TEST(DatasetsOfTest, WhatALostAgentServedDoesNotContradictWhatIsServedNow) {
  AgentState lost = Answering("a:1", {MakeShard("head", 0, 2, kOtherId)});
  lost.status = absl::UnavailableError("gone");
  const auto datasets = DatasetsOf({lost, Answering("b:1", {MakeShard("head", 0, 1)})});
  EXPECT_THAT(datasets.at("head").status, IsOk());
}

TEST(DatasetsOfTest, OfReplicasTheFirstReachableByAddressIsTaken) {
  AgentState lost = Answering("a:1", {MakeShard("head", 0, 1)});
  lost.status = absl::UnavailableError("gone");
  const auto datasets = DatasetsOf({lost, Answering("b:1", {MakeShard("head", 0, 1)}),
                                    Answering("c:1", {MakeShard("head", 0, 1)})});
  ASSERT_THAT(datasets.at("head").status, IsOk());
  ASSERT_EQ(datasets.at("head").agents.size(), 1u);
  EXPECT_EQ(datasets.at("head").agents[0].address, "b:1");
}

TEST(DnsTargetTest, NamesAreTakenApartAndMalformedOnesRefused) {
  DnsName name;
  EXPECT_TRUE(*ParseDnsTarget("dns:///agents.local:50052", &name));
  EXPECT_EQ(name.host, "agents.local");
  EXPECT_EQ(name.port, "50052");
  EXPECT_TRUE(*ParseDnsTarget("dns:///[::1]:50052", &name));
  EXPECT_EQ(name.host, "::1");
  EXPECT_FALSE(*ParseDnsTarget("localhost:50052", &name));
  for (const char* bad : {"", "dns:///", "dns:///host", "dns:///:1", "dns:///host:"}) {
    EXPECT_THAT(ParseDnsTarget(bad, &name), StatusIs(absl::StatusCode::kInvalidArgument)) << bad;
  }
}

TEST(DnsTargetTest, NumericHostsResolveToThemselves) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<std::string> addresses,
                                ResolveAddresses({"127.0.0.1", "50052"}));
  EXPECT_EQ(addresses, std::vector<std::string>({"127.0.0.1:50052"}));
}

// Polls so seldom that only what the registry does by itself counts.
AgentRegistryOptions LazyOptions(const std::vector<std::string>& targets) {
  AgentRegistryOptions options;
  for (const std::string& target : targets) {
    options.endpoints.push_back({target, nullptr});
  }
  options.poll_interval = absl::Hours(1);
  return options;
}

absl::Time Soon() { return absl::Now() + absl::Seconds(20); }

TEST(AgentRegistryTest, BadEndpointsAreRefused) {
  EXPECT_THAT(AgentRegistry::Start(LazyOptions({})), StatusIs(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(AgentRegistry::Start(LazyOptions({"a:1", "a:1"})),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("twice")));
  EXPECT_THAT(AgentRegistry::Start(LazyOptions({"dns:///x"})),
              StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST(AgentRegistryTest, NamesAreFoundAndTheOnlyDatasetNeedsNone) {
  FakeAgent agent({MakeShard("head", 0, 1)});
  agent.Start();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry,
                                AgentRegistry::Start(LazyOptions({agent.address()})));
  ISOSCOPE_ASSERT_OK(registry->WaitUntilReady(Soon()));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DatasetState found, registry->FindComplete("", Soon()));
  EXPECT_EQ(found.dataset.name(), "head");
  EXPECT_THAT(registry->FindComplete("haed", Soon()),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("\"head\"")));
}

TEST(AgentRegistryTest, OneOfSeveralDatasetsMustBeNamed) {
  FakeAgent agent({MakeShard("foot", 0, 1, kOtherId), MakeShard("head", 0, 1)});
  agent.Start();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry,
                                AgentRegistry::Start(LazyOptions({agent.address()})));
  ISOSCOPE_ASSERT_OK(registry->WaitUntilReady(Soon()));
  EXPECT_THAT(registry->Find(""), StatusIs(absl::StatusCode::kInvalidArgument,
                                           AllOf(HasSubstr("\"foot\""), HasSubstr("\"head\""))));
}

TEST(AgentRegistryTest, AReturningAgentServesTheNextFrameAtOnce) {
  auto agent = std::make_unique<FakeAgent>(
      std::vector<isoscope::internal::v1::ShardDescription>{MakeShard("head", 0, 1)});
  agent->Start();
  const int port = agent->port();
  const std::string address = agent->address();
  std::atomic<int> ready_count{0};
  std::atomic<int> lost_count{0};
  AgentRegistryOptions options = LazyOptions({address});
  options.on_readiness = [&](bool is_ready) { (is_ready ? ready_count : lost_count)++; };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry, AgentRegistry::Start(options));
  ISOSCOPE_ASSERT_OK(registry->WaitUntilReady(Soon()));
  EXPECT_EQ(ready_count.load(), 1);

  agent->Stop();
  registry->ReportFailure(address);
  EXPECT_THAT(registry->FindComplete("head", Soon()),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr(address)));
  EXPECT_EQ(lost_count.load(), 1);

  FakeAgent again({MakeShard("head", 0, 1)});
  again.Start(port);
  EXPECT_THAT(registry->FindComplete("head", Soon()), IsOk());
  EXPECT_EQ(ready_count.load(), 2);
}

TEST(AgentRegistryTest, AnAgentThatLiesAboutItsDatasetIsNotUsed) {
  isoscope::internal::v1::ShardDescription bad = MakeShard("head", 0, 1);
  bad.mutable_dataset()->set_block_count(12345);
  FakeAgent agent({bad});
  agent.Start();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry,
                                AgentRegistry::Start(LazyOptions({agent.address()})));
  EXPECT_THAT(registry->FindComplete("head", Soon()),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("block_count is 12345")));
}

TEST(AgentRegistryTest, EveryAddressBehindANameIsAnAgentAndThoseThatVanishAreDropped) {
  FakeAgent first({MakeShard("head", 0, 2)});
  FakeAgent second({MakeShard("head", 1, 2)});
  FakeAgent replacement({MakeShard("head", 1, 2)});
  first.Start();
  second.Start();
  replacement.Start();
  absl::Mutex mutex;
  std::vector<std::string> addresses = {first.address(), second.address()};
  AgentRegistryOptions options = LazyOptions({"dns:///agents:50052"});
  options.resolve = [&](const DnsName& name) -> absl::StatusOr<std::vector<std::string>> {
    EXPECT_EQ(name.host, "agents");
    absl::MutexLock lock(&mutex);
    return addresses;
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry, AgentRegistry::Start(options));
  ISOSCOPE_ASSERT_OK(registry->WaitUntilReady(Soon()));
  EXPECT_EQ(registry->agents().size(), 2u);

  const std::string lost = second.address();
  second.Stop();
  {
    absl::MutexLock lock(&mutex);
    addresses = {first.address(), replacement.address()};
  }
  registry->ReportFailure(lost);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DatasetState found, registry->FindComplete("head", Soon()));
  EXPECT_EQ(found.agents[1].address, replacement.address());
  for (const AgentState& agent : registry->agents()) {
    EXPECT_NE(agent.address, lost);
  }
}

TEST(AgentRegistryTest, ANameThatCannotBeResolvedIsReportedAsSuch) {
  AgentRegistryOptions options = LazyOptions({"dns:///agents:50052"});
  options.resolve = [](const DnsName&) -> absl::StatusOr<std::vector<std::string>> {
    return absl::UnavailableError("can't resolve agents:50052");
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry, AgentRegistry::Start(options));
  EXPECT_THAT(registry->FindComplete("", Soon()),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("can't resolve")));
}

}  // namespace
}  // namespace isoscope::server
