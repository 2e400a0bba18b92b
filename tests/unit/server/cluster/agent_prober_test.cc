#include "server/cluster/agent_prober.h"

#include <memory>
#include <thread>
#include <vector>

#include "absl/synchronization/notification.h"
#include "absl/types/span.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/unit/server/fake_agent.h"

namespace isoscope::server {
namespace {

using testing::FakeAgent;
using testing::MakeShard;
using testing::StatusIs;

TEST(AgentProberTest, AllAreAskedOverFreshChannelsThatAreLeftBehind) {
  FakeAgent first({MakeShard("head", 0, 2)});
  FakeAgent second({MakeShard("head", 1, 2)});
  first.Start();
  second.Start();
  std::vector<AgentProbe> probes(2);
  probes[0].address = first.address();
  probes[1].address = second.address();
  for (int round = 0; round < 2; ++round) {  // the second over the same channels
    ProbeAgents(absl::MakeSpan(probes), base::Cancellation());
    for (int i = 0; i < 2; ++i) {
      const AgentProbe& probe = probes[static_cast<std::size_t>(i)];
      ISOSCOPE_ASSERT_OK(probe.answer);
      ASSERT_EQ(probe.answer->shards_size(), 1);
      EXPECT_EQ(probe.answer->shards(0).shard_index(), i);
      EXPECT_EQ(probe.answer->version(), "1.2.3");
      EXPECT_NE(probe.channel, nullptr);
      EXPECT_NE(probe.export_channel, nullptr);
      EXPECT_NE(probe.export_channel, probe.channel);
    }
  }
}

TEST(AgentProberTest, OneThatCannotBeReachedDoesNotHinderTheOthers) {
  FakeAgent agent({MakeShard("head", 0, 1)});
  agent.Start();
  FakeAgent stopped({});
  stopped.Start();
  std::vector<AgentProbe> probes(2);
  probes[0].address = stopped.address();
  probes[1].address = agent.address();
  stopped.Stop();
  ProbeAgents(absl::MakeSpan(probes), base::Cancellation());
  EXPECT_THAT(probes[0].answer, StatusIs(absl::StatusCode::kUnavailable));
  ISOSCOPE_EXPECT_OK(probes[1].answer);
}

TEST(AgentProberTest, NobodyToAskIsAnsweredAtOnce) { ProbeAgents({}, base::Cancellation()); }

TEST(AgentProberTest, CancellationEndsTheWaitForAnAgentThatHangs) {
  absl::Notification is_asked;
  absl::Notification may_answer;
  FakeAgent agent({});
  agent.on_describe = [&] {
    is_asked.Notify();
    may_answer.WaitForNotification();
  };
  agent.Start();
  std::vector<AgentProbe> probes(1);
  probes[0].address = agent.address();
  base::Cancellation cancellation;
  std::thread canceller([&] {
    is_asked.WaitForNotification();
    cancellation.Cancel();
  });
  ProbeAgents(absl::MakeSpan(probes), cancellation);
  EXPECT_THAT(probes[0].answer, StatusIs(absl::StatusCode::kCancelled));
  canceller.join();
  may_answer.Notify();
}

}  // namespace
}  // namespace isoscope::server
