#include "server/cluster/dataset_catalog.h"

#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/error_reason.h"
#include "core/base/retry_delay.h"
#include "core/frame/picture_revision.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/server/make_shard.h"
#include "wire/frame_convert.h"

namespace isoscope::server {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::ElementsAreArray;
using ::testing::HasSubstr;
using testing::IsOk;
using testing::MakeShard;
using testing::SetsOf;
using testing::StatusIs;

constexpr char kOtherId[] = "ffffffffffffffffffffffffffffffff";

using Shards = std::vector<isoscope::internal::v1::ShardDescription>;

AgentState Answering(const std::string& address, Shards shards) {
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
  EXPECT_THAT(SetsOf(head), ElementsAre("0,2: b:1", "1: a:1"));
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

isoscope::internal::v1::DescribeShardsResponse OpeningAnswer(const std::string& dataset) {
  isoscope::internal::v1::DescribeShardsResponse answer;
  *answer.mutable_picture_revision() =
      wire::ToProto(frame::PictureRevision{.number = 1, .driver = ""});
  answer.mutable_opening()->set_shard_count(8);
  answer.mutable_opening()->set_open_shard_count(3);
  answer.mutable_opening()->set_table_bytes(4 << 20);
  answer.mutable_opening()->set_read_bytes(1 << 20);
  answer.add_opening_datasets(dataset);
  return answer;
}

// Symptom: an agent that opens its shards was "unreachable (Deadline Exceeded)".
TEST(AdoptAnswerTest, AnAgentThatOpensItsShardsSaysHowFarAndKeepsThoseOfItsLastAnswer) {
  AgentState agent = Answering("a:1", {MakeShard("head", 0, 1)});
  AdoptAnswer(OpeningAnswer("head"), &agent);
  EXPECT_THAT(agent.status, StatusIs(absl::StatusCode::kUnavailable,
                                     HasSubstr("3 of 8 shards are open, 1.0 MiB of 4.0 MiB")));
  ASSERT_TRUE(agent.opening.has_value());
  EXPECT_EQ(agent.shards.size(), 1U);
  EXPECT_THAT(DescribeUnreachable({agent}), AllOf(HasSubstr("opening their shards: a:1"),
                                                  ::testing::Not(HasSubstr("can't be reached"))));
  AdoptAnswer(absl::UnavailableError("gone"), &agent);
  EXPECT_FALSE(agent.opening.has_value());
  EXPECT_TRUE(agent.opening_datasets.empty());
}

TEST(DatasetsOfTest, AShardThatIsBeingOpenedIsUnavailableForNow) {
  AgentState opening = Answering("b:1", {});
  AdoptAnswer(OpeningAnswer("head"), &opening);
  const auto datasets = DatasetsOf({Answering("a:1", {MakeShard("head", 0, 2)}), opening});
  const absl::Status status = datasets.at("head").status;
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kUnavailable, HasSubstr("shard 1 of 2")));
  EXPECT_EQ(base::ReasonOf(status), base::ErrorReason::kAgentOpening);
  EXPECT_EQ(base::RetryDelayOf(status), absl::Seconds(1));
  // An agent that opens another dataset changes nothing.
  AdoptAnswer(OpeningAnswer("other"), &opening);
  EXPECT_THAT(DatasetsOf({Answering("a:1", {MakeShard("head", 0, 2)}), opening}).at("head").status,
              StatusIs(absl::StatusCode::kFailedPrecondition));
}

TEST(FindDatasetTest, ADatasetThatIsBeingOpenedIsUnavailableForNow) {
  for (const char* const name : {"head", ""}) {
    const absl::Status status = FindDataset({}, name, "agents that open", {}, {"head"}).status();
    EXPECT_THAT(status, StatusIs(absl::StatusCode::kUnavailable, HasSubstr("agents that open")));
    EXPECT_EQ(base::ReasonOf(status), base::ErrorReason::kAgentOpening);
  }
  EXPECT_THAT(FindDataset({}, "torso", "", {}, {"head"}), StatusIs(absl::StatusCode::kNotFound));
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

TEST(DatasetsOfTest, ShardsOfTheSameReachableAgentsMakeASet) {
  AgentState lost = Answering("a:1", {MakeShard("head", 0, 3)});
  lost.status = absl::UnavailableError("gone");
  const Shards all = {MakeShard("head", 0, 3), MakeShard("head", 1, 3), MakeShard("head", 2, 3)};
  const auto datasets =
      DatasetsOf({lost, Answering("b:1", all), Answering("c:1", {all[0], all[2]})});
  ASSERT_THAT(datasets.at("head").status, IsOk());
  EXPECT_THAT(SetsOf(datasets.at("head")), ElementsAre("0,2: b:1 c:1", "1: b:1"));
}

TEST(DatasetsOfTest, WithMissingShardsTheOthersCanStillBeDrawn) {
  const auto datasets = DatasetsOf({Answering("a:1", {MakeShard("head", 1, 3)})});
  EXPECT_THAT(datasets.at("head").status, StatusIs(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(SetsOf(datasets.at("head")), ElementsAre("1: a:1"));
}

AgentState OfRevision(const std::string& address, int number, Shards shards) {
  AgentState agent = Answering(address, std::move(shards));
  agent.picture_revision.number = number;
  return agent;
}

TEST(DatasetsOfTest, WhileAgentsAreUpdatedOneRevisionIsUsedAndItIsComplete) {
  const auto shard = [](int index) { return Shards{MakeShard("head", index, 2)}; };
  // Two replicas of each of two shards are updated one after the other, from revision 6 to 7.
  const struct {
    std::vector<int> revisions;  // of a0, a1, b0, b1; 0: it is down
    std::vector<std::string> sets;
  } cases[] = {
      {{6, 6, 6, 6}, {"0: a0 a1", "1: b0 b1"}}, {{0, 6, 6, 6}, {"0: a1", "1: b0 b1"}},
      {{7, 6, 6, 6}, {"0: a1", "1: b0 b1"}},    {{7, 6, 0, 6}, {"0: a1", "1: b1"}},
      {{7, 6, 7, 6}, {"0: a0", "1: b0"}},  // both are complete: the newer one
      {{7, 0, 7, 6}, {"0: a0", "1: b0"}},       {{7, 7, 7, 6}, {"0: a0 a1", "1: b0"}},
      {{7, 7, 7, 7}, {"0: a0 a1", "1: b0 b1"}},
  };
  for (const auto& [revisions, sets] : cases) {
    std::vector<AgentState> agents;
    for (std::size_t i = 0; i < 4; ++i) {
      agents.push_back(OfRevision(absl::StrCat(i < 2 ? "a" : "b", i % 2),
                                  revisions[i] == 0 ? 6 : revisions[i], shard(i < 2 ? 0 : 1)));
      if (revisions[i] == 0) {
        agents.back().status = absl::UnavailableError("restarts");
      }
    }
    const DatasetState head = DatasetsOf(agents).at("head");
    SCOPED_TRACE(absl::StrJoin(revisions, " "));
    ISOSCOPE_EXPECT_OK(head.status);
    EXPECT_THAT(SetsOf(head), ElementsAreArray(sets));
  }
}

TEST(DatasetsOfTest, AnAgentWithAnotherVolumeUnderTheNameIsNotUsedWhileTheOthersAreComplete) {
  const std::vector<AgentState> agents = {Answering("a:1", {MakeShard("head", 0, 2)}),
                                          Answering("b:1", {MakeShard("head", 1, 2)}),
                                          Answering("c:1", {MakeShard("head", 0, 1, kOtherId)})};
  const DatasetState head = DatasetsOf(agents).at("head");
  ISOSCOPE_EXPECT_OK(head.status);
  EXPECT_THAT(SetsOf(head), ElementsAre("0: a:1", "1: b:1"));
  EXPECT_THAT(head.contradiction, AllOf(HasSubstr("a:1"), HasSubstr("c:1")));

  // Not even when the others are lost: the two volumes could not be told apart.
  std::vector<AgentState> lost = agents;
  lost[1].status = absl::UnavailableError("gone");
  EXPECT_THAT(DatasetsOf(lost).at("head").status,
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("contradict")));
  EXPECT_THAT(SetsOf(DatasetsOf(lost).at("head")), ElementsAre());
  lost[0].status = absl::UnavailableError("gone");
  EXPECT_THAT(DatasetsOf(lost).at("head").status,
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       AllOf(HasSubstr("most of them are lost"), HasSubstr("a:1"))));
}

TEST(DatasetsOfTest, OfTwoCompleteVolumesUnderOneNameNoneIsGuessed) {
  const DatasetState head = DatasetsOf({Answering("a:1", {MakeShard("head", 0, 1)}),
                                        Answering("b:1", {MakeShard("head", 0, 1, kOtherId)})})
                                .at("head");
  EXPECT_THAT(head.status, StatusIs(absl::StatusCode::kFailedPrecondition,
                                    AllOf(HasSubstr("a:1"), HasSubstr("b:1"))));
  EXPECT_THAT(SetsOf(head), ElementsAre());
}

TEST(DatasetsOfTest, TwoVolumesWhoseAgentsAreAllLostAreKnownByName) {
  std::vector<AgentState> lost = {Answering("a:1", {MakeShard("head", 0, 1)}),
                                  Answering("b:1", {MakeShard("head", 0, 1, kOtherId)})};
  for (AgentState& agent : lost) {
    agent.status = absl::UnavailableError("gone");
  }
  EXPECT_THAT(DatasetsOf(lost).at("head").status,
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("not served")));
}

TEST(RemoveAgentsTest, SetsWithoutAnotherAgentVanish) {
  DatasetState head = DatasetsOf({Answering("a:1", {MakeShard("head", 0, 2)}),
                                  Answering("b:1", {MakeShard("head", 0, 2)}),
                                  Answering("c:1", {MakeShard("head", 1, 2)})})
                          .at("head");
  RemoveAgents({"a:1", "x:1"}, &head.replica_sets);
  EXPECT_THAT(SetsOf(head), ElementsAre("0: b:1", "1: c:1"));
  RemoveAgents({"c:1"}, &head.replica_sets);
  EXPECT_THAT(SetsOf(head), ElementsAre("0: b:1"));
}

TEST(DatasetsOfTest, AgentsThatWouldDrawDifferentPicturesDoNotServeADataset) {
  AgentState other = Answering("b:1", {MakeShard("head", 1, 2)});
  other.picture_revision.back_end = frame::BackEnd::kEgl;
  other.picture_revision.driver = "llvmpipe";
  const auto datasets = DatasetsOf({Answering("a:1", {MakeShard("head", 0, 2)}), other});
  EXPECT_THAT(datasets.at("head").status,
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       AllOf(HasSubstr("a:1 has picture revision"), HasSubstr("b:1 has"),
                             HasSubstr("egl (llvmpipe)"))));
  EXPECT_TRUE(datasets.at("head").is_served);
  // An agent that does not work on the dataset does not matter.
  const auto spared = DatasetsOf({Answering("a:1", {MakeShard("head", 0, 1)}), [] {
                                    AgentState spare = Answering("b:1", {MakeShard("head", 0, 1)});
                                    spare.picture_revision.number = 1;
                                    return spare;
                                  }()});
  EXPECT_THAT(spared.at("head").status, IsOk());
}

isoscope::internal::v1::DescribeShardsResponse AnswerOf(
    const isoscope::internal::v1::ShardDescription& shard) {
  isoscope::internal::v1::DescribeShardsResponse answer;
  answer.set_version("1.2.3");
  answer.set_renderer("fake");
  *answer.mutable_picture_revision() = wire::ToProto(frame::PictureRevision());
  *answer.add_shards() = shard;
  return answer;
}

TEST(AdoptAnswerTest, ALostAgentIsRememberedForItsShardsAndALiarIsNot) {
  AgentState agent;
  AdoptAnswer(AnswerOf(MakeShard("head", 0, 1)), &agent);
  ISOSCOPE_EXPECT_OK(agent.status);
  EXPECT_EQ(agent.version, "1.2.3");
  EXPECT_EQ(agent.renderer, "fake");
  EXPECT_EQ(agent.shards.size(), 1u);
  EXPECT_EQ(agent.picture_revision, frame::PictureRevision());

  AdoptAnswer(absl::UnavailableError("gone"), &agent);
  EXPECT_THAT(agent.status, StatusIs(absl::StatusCode::kUnavailable));
  EXPECT_EQ(agent.shards.size(), 1u);

  isoscope::internal::v1::ShardDescription bad = MakeShard("head", 0, 1);
  bad.mutable_dataset()->set_block_count(12345);
  AdoptAnswer(AnswerOf(bad), &agent);
  EXPECT_THAT(agent.status,
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("block_count is 12345")));
  EXPECT_TRUE(agent.shards.empty());

  bad = MakeShard("head", 0, 2);
  bad.set_shard_index(2);
  AdoptAnswer(AnswerOf(bad), &agent);
  EXPECT_THAT(agent.status,
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("shard_index is 2")));
}

TEST(FindDatasetTest, NamesAreFoundAndTheOnlyDatasetNeedsNone) {
  const auto datasets = DatasetsOf({Answering("a:1", {MakeShard("head", 0, 1)})});
  for (const char* name : {"", "head"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DatasetState* const found, FindDataset(datasets, name, ""));
    EXPECT_EQ(found, &datasets.at("head"));
  }
  EXPECT_THAT(FindDataset(datasets, "haed", "agents that can't be reached: b:1"),
              StatusIs(absl::StatusCode::kNotFound,
                       AllOf(HasSubstr("\"haed\""), HasSubstr("\"head\""), HasSubstr("b:1"))));
}

TEST(FindDatasetTest, OneOfSeveralMustBeNamed) {
  const auto datasets =
      DatasetsOf({Answering("a:1", {MakeShard("foot", 0, 1, kOtherId), MakeShard("head", 0, 1)})});
  EXPECT_THAT(FindDataset(datasets, "", ""),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("\"foot\""), HasSubstr("\"head\""))));
}

TEST(FindDatasetTest, WithoutADatasetTheUnreachableAgentsAreNamed) {
  EXPECT_THAT(FindDataset({}, "", "agents that can't be reached: b:1"),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("b:1")));
  EXPECT_THAT(FindDataset({}, "head", ""),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("no dataset is served")));
}

}  // namespace
}  // namespace isoscope::server
