#include "server/dataset_catalog.h"

#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/frame/picture_revision.h"
#include "core/rpc/frame_convert.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/server/make_shard.h"

namespace isoscope::server {
namespace {

using ::testing::AllOf;
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

TEST(DatasetsOfTest, AgentsThatWouldDrawDifferentPicturesDoNotServeADataset) {
  AgentState other = Answering("b:1", {MakeShard("head", 1, 2)});
  other.picture_revision.back_end = frame::BackEnd::kEgl;
  other.picture_revision.driver = "llvmpipe";
  const auto datasets = DatasetsOf({Answering("a:1", {MakeShard("head", 0, 2)}), other});
  EXPECT_THAT(datasets.at("head").status,
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       AllOf(HasSubstr("a:1 has picture revision"), HasSubstr("b:1 has"),
                             HasSubstr("egl (llvmpipe)"))));
  EXPECT_TRUE(datasets.at("head").agents.empty());
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
  *answer.mutable_picture_revision() = rpc::ToProto(frame::PictureRevision());
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
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DatasetState found, FindDataset(datasets, name, ""));
    EXPECT_EQ(found.dataset.name(), "head");
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
