#include "server/cluster/replica_board.h"

#include <map>
#include <numeric>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"

namespace isoscope::server {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

ReplicaSet SetOf(std::vector<int> shards, const std::vector<std::string>& addresses) {
  ReplicaSet set;
  set.shard_indices = std::move(shards);
  for (const std::string& address : addresses) {
    set.agents.push_back({address, nullptr});
  }
  return set;
}

std::vector<int> FirstShards(int count) {
  std::vector<int> shards(static_cast<std::size_t>(count));
  std::iota(shards.begin(), shards.end(), 0);
  return shards;
}

// The agent that works on each shard.
std::map<int, std::string> WorkersOf(const std::vector<FramePart>& parts) {
  std::map<int, std::string> workers;
  for (const FramePart& part : parts) {
    for (const int shard : part.shard_indices) {
      EXPECT_TRUE(workers.emplace(shard, part.replicas.front().address).second)
          << "shard " << shard << " is in two parts";
    }
  }
  return workers;
}

std::vector<std::string> ReplicasOf(const FramePart& part) {
  std::vector<std::string> addresses;
  for (const ServingAgent& agent : part.replicas) {
    addresses.push_back(agent.address);
  }
  return addresses;
}

const base::MonotonicTime kNow = base::MonotonicTime() + absl::Seconds(1'000'000);

// Sets of one shard each have no share to keep: only their ranks spread them.
TEST(ReplicaBoardTest, EachShardRanksItsAgentsAnew) {
  const ReplicaBoard board;
  std::vector<ReplicaSet> sets;
  for (int shard = 0; shard < 60; ++shard) {
    sets.push_back(SetOf({shard}, {"a", "b", "c"}));
  }
  std::map<std::string, int> shards_of;
  for (const auto& [shard, worker] : WorkersOf(board.Choose(sets, "key", kNow))) {
    ++shards_of[worker];
  }
  for (const char* const agent : {"a", "b", "c"}) {
    EXPECT_GE(shards_of[agent], 10) << agent;
  }
}

TEST(ReplicaBoardTest, AgentsWithoutReplicasWorkOnAllOfTheirShards) {
  const ReplicaBoard board;
  const auto parts = board.Choose({SetOf({1, 3}, {"a"}), SetOf({0, 2}, {"b"})}, "key", kNow);
  ASSERT_EQ(parts.size(), 2u);
  EXPECT_THAT(parts[0].shard_indices, ElementsAre(0, 2));
  EXPECT_THAT(ReplicasOf(parts[0]), ElementsAre("b"));
  EXPECT_THAT(parts[1].shard_indices, ElementsAre(1, 3));
}

TEST(ReplicaBoardTest, ShardsAreSpreadEvenlyAndEveryPartHasAllReplicas) {
  const ReplicaBoard board;
  for (const int shard_count : {1, 2, 3, 4, 7, 64}) {
    for (const std::size_t agent_count : {2u, 3u, 5u}) {
      std::vector<std::string> agents;
      for (std::size_t i = 0; i < agent_count; ++i) {
        agents.push_back(absl::StrCat("agent-", i));
      }
      SCOPED_TRACE(absl::StrCat(shard_count, " shards, ", agent_count, " agents"));
      const auto parts = board.Choose({SetOf(FirstShards(shard_count), agents)}, "key", kNow);
      const std::map<int, std::string> workers = WorkersOf(parts);
      EXPECT_EQ(workers.size(), static_cast<std::size_t>(shard_count));
      const std::size_t share =
          (static_cast<std::size_t>(shard_count) + agent_count - 1) / agent_count;
      for (const FramePart& part : parts) {
        EXPECT_LE(part.shard_indices.size(), share);
        const std::vector<std::string> replicas = ReplicasOf(part);
        EXPECT_EQ(std::set<std::string>(replicas.begin(), replicas.end()),
                  std::set<std::string>(agents.begin(), agents.end()));
      }
    }
  }
}

TEST(ReplicaBoardTest, TheSameIsovaluesFindTheSameAgentsAndOthersAreSpread) {
  const ReplicaBoard board;
  const std::vector<ReplicaSet> sets = {SetOf({0}, {"a", "b"})};
  std::map<std::string, int> counts;
  for (int isovalue = 0; isovalue < 400; ++isovalue) {
    const std::string key = ReplicaKeyOf("id", {{.isovalue = static_cast<double>(isovalue)}});
    const std::string agent = board.Choose(sets, key, kNow)[0].replicas[0].address;
    EXPECT_EQ(board.Choose(sets, key, kNow)[0].replicas[0].address, agent);
    ++counts[agent];
  }
  // Half of 400 fair throws, five standard deviations.
  EXPECT_NEAR(counts["a"], 200, 50);
  using volume::InsideRule;
  EXPECT_EQ(ReplicaKeyOf("id", {{.isovalue = 1}, {.isovalue = 2}}),
            ReplicaKeyOf("id", {{.isovalue = 2}, {.isovalue = 1}}));
  EXPECT_NE(ReplicaKeyOf("id", {{.isovalue = 1}}),
            ReplicaKeyOf("id", {{.isovalue = 1.0000000001}}));
  EXPECT_NE(ReplicaKeyOf("id", {InsideRule::OfLabels({1})}),
            ReplicaKeyOf("id", {InsideRule::OfLabels({1, 2})}));
  EXPECT_NE(ReplicaKeyOf("id", {InsideRule::OfLabels({0})}),
            ReplicaKeyOf("id", {InsideRule::OfIsovalue(0)}));
  EXPECT_EQ(ReplicaKeyOf("id", {InsideRule::OfLabels({1}), InsideRule::OfIsovalue(5)}),
            ReplicaKeyOf("id", {InsideRule::OfIsovalue(5), InsideRule::OfLabels({1})}));
}

TEST(ReplicaBoardTest, AnAgentThatGoesMovesItsOwnShardsAndFewOthers) {
  const ReplicaBoard board;
  const std::vector<int> shards = FirstShards(60);
  const auto before = WorkersOf(board.Choose({SetOf(shards, {"a", "b", "c"})}, "key", kNow));
  const auto after = WorkersOf(board.Choose({SetOf(shards, {"a", "c"})}, "key", kNow));
  int moved = 0;
  for (const auto& [shard, agent] : before) {
    moved += agent != "b" && after.at(shard) != agent ? 1 : 0;
  }
  EXPECT_LE(moved, 12) << "of 40 that need not";
}

TEST(ReplicaBoardTest, OneFrameAfterTheOtherKeepsItsAgentAndManyAtATimeAreShared) {
  ReplicaBoard board;
  const std::vector<ReplicaSet> sets = {SetOf({0}, {"a", "b"})};
  const std::string preferred = board.Choose(sets, "key", kNow)[0].replicas[0].address;
  for (int i = 0; i < 10; ++i) {
    const FramePart part = board.Choose(sets, "key", kNow)[0];
    EXPECT_EQ(part.replicas[0].address, preferred);
    const ReplicaBoard::Lease lease = board.Take(part.replicas[0].address);
  }
  std::vector<ReplicaBoard::Lease> leases;
  std::map<std::string, int> counts;
  for (int i = 0; i < 40; ++i) {
    const FramePart part = board.Choose(sets, "key", kNow)[0];
    EXPECT_EQ(part.replicas.size(), 2u);
    ++counts[part.replicas[0].address];
    leases.push_back(board.Take(part.replicas[0].address));
  }
  for (const auto& [agent, count] : counts) {
    EXPECT_LE(count, 26) << agent;  // 1.25 times the half, and the last one
    EXPECT_GE(count, 14) << agent;
  }
  leases.clear();
  EXPECT_EQ(board.Choose(sets, "key", kNow)[0].replicas[0].address, preferred);
}

TEST(ReplicaBoardTest, AnAgentInTroubleComesLastForLongerEachTimeUntilItSucceeds) {
  ReplicaBoard board;
  const std::vector<ReplicaSet> sets = {SetOf({0}, {"a", "b", "c"})};
  const std::string preferred = board.Choose(sets, "key", kNow)[0].replicas[0].address;
  const auto is_last = [&](base::MonotonicTime now) {
    return board.Choose(sets, "key", now)[0].replicas.back().address == preferred;
  };
  const auto is_first = [&](base::MonotonicTime now) {
    return board.Choose(sets, "key", now)[0].replicas.front().address == preferred;
  };
  base::MonotonicTime now = kNow;
  for (const int seconds : {1, 2, 4, 8, 16, 30, 30}) {
    board.NoteTrouble(preferred, now);
    EXPECT_TRUE(is_last(now + absl::Seconds(seconds) - absl::Milliseconds(1)));
    now += absl::Seconds(seconds);
    EXPECT_TRUE(is_first(now));
  }
  board.NoteTrouble(preferred, now);
  board.NoteSuccess(preferred);
  EXPECT_TRUE(is_first(now));
  board.NoteTrouble(preferred, now);
  EXPECT_TRUE(is_first(now + absl::Seconds(1))) << "it was not forgiven";
}

TEST(ReplicaBoardTest, WhenAllAreInTroubleTheyAreUsedAllTheSame) {
  ReplicaBoard board;
  board.NoteTrouble("a", kNow);
  board.NoteTrouble("b", kNow);
  const auto parts = board.Choose({SetOf({0, 1}, {"a", "b"})}, "key", kNow);
  EXPECT_EQ(WorkersOf(parts).size(), 2u);
}

TEST(ReplicaBoardTest, OnlyIdleAgentsAndOnePartInTwentyAreHedged) {
  ReplicaBoard board;
  EXPECT_FALSE(board.TryHedge("b")) << "before any part";
  for (int i = 0; i < 19; ++i) {
    const ReplicaBoard::Lease lease = board.Take("a");
  }
  EXPECT_FALSE(board.TryHedge("b"));
  const ReplicaBoard::Lease lease = board.Take("a");
  EXPECT_FALSE(board.TryHedge("a")) << "it is not idle";
  EXPECT_TRUE(board.TryHedge("b"));
  EXPECT_FALSE(board.TryHedge("b"));
}

TEST(ReplicaBoardTest, QuietHoursDoNotPayForAStormOfSecondAttempts) {
  ReplicaBoard board;
  const auto begin_parts = [&board](int count) {
    for (int i = 0; i < count; ++i) {
      const ReplicaBoard::Lease lease = board.Take("a");
    }
  };
  const auto hedge_all = [&board] {
    int count = 0;
    while (count < 1000 && board.TryHedge("b")) {
      ++count;
    }
    return count;
  };
  begin_parts(100'000);
  EXPECT_EQ(hedge_all(), static_cast<int>(ReplicaBoard::kMaxHedgeBurst));
  // In the long run it is the share, however often the bucket is emptied.
  int count = 0;
  for (int i = 0; i < 1000; ++i) {
    begin_parts(30);
    count += hedge_all();
  }
  EXPECT_NEAR(count, 1500, 1);
}

TEST(ReplicaBoardTest, AnAgentIsInTroubleOnlyIfItWasWaitedForLongEnough) {
  ReplicaBoard board;
  const std::vector<ReplicaSet> sets = {SetOf({0}, {"a", "b"})};
  const std::string preferred = board.Choose(sets, "key", kNow)[0].replicas[0].address;
  const auto is_first = [&] {
    return board.Choose(sets, "key", kNow)[0].replicas[0].address == preferred;
  };
  board.NoteUnanswered(preferred, ReplicaBoard::kLateAfter - absl::Milliseconds(1), kNow);
  EXPECT_TRUE(is_first());
  board.NoteUnanswered(preferred, ReplicaBoard::kLateAfter, kNow);
  EXPECT_FALSE(is_first());
}

TEST(MissingShardsTest, AreThoseOfNoPart) {
  EXPECT_THAT(MissingShards(5, {{{1, 4}, {}}, {{2}, {}}}), ElementsAre(0, 3));
  EXPECT_THAT(MissingShards(2, {{{0, 1}, {}}}), IsEmpty());
}

}  // namespace
}  // namespace isoscope::server
