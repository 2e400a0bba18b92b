// Levels that agents tell become levels that frames can be drawn from, and a request chooses one.

#include "server/cluster/served_levels.h"

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "server/cluster/dataset_catalog.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/server/make_shard.h"
#include "wire/proto_convert.h"

namespace isoscope::server {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::IsOk;
using testing::MakeShard;
using ::testing::Not;
using testing::StatusIs;
using volume::LevelFilter;

namespace internal = isoscope::internal::v1;
namespace v1 = isoscope::v1;

LevelOwner Owner(const std::string& address, std::vector<int> levels,
                 LevelFilter filter = LevelFilter::kMean, bool is_draining = false) {
  LevelOwner owner{{{.address = address, .channel = nullptr}, is_draining}};
  owner.owned = {.levels = std::move(levels), .filter = filter};
  return owner;
}

// "1 mean: 0,1 a:1 b:1" for each level.
std::vector<std::string> TextOf(const std::vector<ServedLevel>& levels) {
  std::vector<std::string> text;
  for (const ServedLevel& level : levels) {
    text.push_back(absl::StrCat(level.level, " ", volume::NameOf(level.filter), ":"));
    for (const ReplicaSet& set : level.replica_sets) {
      absl::StrAppend(&text.back(), " ", absl::StrJoin(set.shard_indices, ","));
      for (const ServingAgent& agent : set.agents) {
        absl::StrAppend(&text.back(), " ", agent.address);
      }
    }
  }
  return text;
}

TEST(ServedLevelsTest, ALevelIsServedOnceEveryShardHasIt) {
  EXPECT_THAT(TextOf(ServedLevelsOf({{0, {Owner("a:1", {1, 2, 3})}}, {1, {Owner("b:1", {1, 3})}}})),
              ElementsAre("1 mean: 0 a:1 1 b:1", "3 mean: 0 a:1 1 b:1"));
  EXPECT_THAT(ServedLevelsOf({{0, {Owner("a:1", {1})}}, {1, {Owner("b:1", {})}}}), IsEmpty());
  EXPECT_THAT(ServedLevelsOf({}), IsEmpty());
}

// A shard without a level serves the rest: its replica draws the level.
TEST(ServedLevelsTest, AgentsWithoutALevelAreNoReplicasOfIt) {
  const auto levels = ServedLevelsOf({{0, {Owner("a:1", {}), Owner("b:1", {1})}},
                                      {1, {Owner("a:1", {1}), Owner("b:1", {1})}},
                                      {2, {Owner("a:1", {1}), Owner("b:1", {1})}}});
  EXPECT_THAT(TextOf(levels), ElementsAre("1 mean: 0 b:1 1,2 a:1 b:1"));
}

TEST(ServedLevelsTest, DrainingAgentsDrawALevelOnlyIfNoOtherCan) {
  const auto levels =
      ServedLevelsOf({{0, {Owner("a:1", {1}, LevelFilter::kMean, true), Owner("b:1", {1})}},
                      {1, {Owner("a:1", {1}, LevelFilter::kMean, true)}}});
  EXPECT_THAT(TextOf(levels), ElementsAre("1 mean: 0 b:1 1 a:1"));
}

TEST(ServedLevelsTest, LevelsOfTwoFiltersNeverMix) {
  EXPECT_THAT(ServedLevelsOf({{0, {Owner("a:1", {1}, LevelFilter::kMean)}},
                              {1, {Owner("b:1", {1}, LevelFilter::kMajority)}}}),
              IsEmpty());
  const auto levels = ServedLevelsOf(
      {{0, {Owner("a:1", {1, 2}, LevelFilter::kMajority), Owner("c:1", {1}, LevelFilter::kMean)}},
       {1, {Owner("b:1", {1, 2}, LevelFilter::kMajority)}}});
  EXPECT_THAT(TextOf(levels), ElementsAre("1 majority: 0 a:1 1 b:1", "2 majority: 0 a:1 1 b:1"));
}

internal::ShardDescription WithLevels(internal::ShardDescription shard,
                                      const std::vector<std::int32_t>& levels,
                                      v1::DatasetLevel::Filter filter) {
  shard.mutable_levels()->mutable_levels()->Assign(levels.begin(), levels.end());
  shard.mutable_levels()->set_filter(filter);
  return shard;
}

AgentState Agent(const std::string& address, internal::ShardDescription shard) {
  AgentState state;
  state.address = address;
  internal::DescribeShardsResponse answer;
  answer.mutable_picture_revision()->set_number(1);
  answer.mutable_picture_revision()->set_back_end(internal::PictureRevision::BACK_END_CPU);
  *answer.add_shards() = std::move(shard);
  AdoptAnswer(std::move(answer), &state);
  return state;
}

// MakeShard has 9^3 samples: level 1 has 4^3, level 2 has 2^3.
// What a view in motion gets: at least as coarse as its time needs, never finer than it asks.
TEST(ServedLevelsTest, ACoarserLevelIsTheFirstServedOneThatIsCoarseEnough) {
  const std::vector<ServedLevel> levels =
      ServedLevelsOf({{0, {Owner("a:1", {1, 3, 4})}}, {1, {Owner("b:1", {1, 3, 4})}}});
  ASSERT_EQ(levels.size(), 3U);
  const std::vector<volume::InsideRule> isovalue = {volume::InsideRule::OfIsovalue(7)};
  const auto level_of = [&](const ServedLevel* chosen, int least) {
    const ServedLevel* const coarser = CoarserOf(levels, isovalue, chosen, least);
    return coarser == nullptr ? 0 : coarser->level;
  };
  EXPECT_EQ(level_of(nullptr, 0), 0);
  EXPECT_EQ(level_of(nullptr, 1), 1);
  EXPECT_EQ(level_of(nullptr, 2), 3);
  EXPECT_EQ(level_of(nullptr, 9), 4) << "the coarsest one";
  EXPECT_EQ(level_of(&levels[1], 0), 3);
  EXPECT_EQ(level_of(&levels[1], 1), 3) << "never finer";
  EXPECT_EQ(level_of(&levels[2], 9), 4);
  EXPECT_EQ(CoarsestOf(levels, isovalue), 4);
  EXPECT_EQ(CoarsestOf({}, isovalue), 0);
  EXPECT_EQ(CoarserOf({}, isovalue, nullptr, 3), nullptr);
}

TEST(ServedLevelsTest, TheDatasetTellsGridBlocksAndFilter) {
  const DatasetState state =
      DatasetsOf({Agent("a:1", WithLevels(MakeShard("head", 0, 2), {1, 2},
                                          v1::DatasetLevel::FILTER_MAJORITY)),
                  Agent("b:1", WithLevels(MakeShard("head", 1, 2), {1, 2},
                                          v1::DatasetLevel::FILTER_MAJORITY))})
          .at("head");
  ASSERT_THAT(state.status, IsOk());
  ASSERT_EQ(state.dataset.levels_size(), 2);
  const v1::DatasetLevel& second = state.dataset.levels(1);
  EXPECT_EQ(second.level(), 2);
  EXPECT_EQ(second.filter(), v1::DatasetLevel::FILTER_MAJORITY);
  EXPECT_EQ(second.block_count(), 1);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::GridGeometry grid,
                                wire::GeometryFromProto(second.geometry(), "geometry"));
  EXPECT_EQ(grid.sample_dims, (math::Index3{2, 2, 2}));
  EXPECT_EQ(grid.spacing, (math::Vec3d{4, 4, 4}));
  EXPECT_EQ(grid.origin, (math::Vec3d{1.5, 1.5, 1.5}));
  EXPECT_THAT(TextOf(state.levels),
              ElementsAre("1 majority: 0 a:1 1 b:1", "2 majority: 0 a:1 1 b:1"));
}

TEST(ServedLevelsTest, AnAgentWithMalformedLevelsIsRefused) {
  const auto refuse = [](const std::vector<std::int32_t>& levels, v1::DatasetLevel::Filter filter,
                         const std::string& message) {
    const AgentState agent = Agent("a:1", WithLevels(MakeShard("head", 0, 1), levels, filter));
    EXPECT_THAT(agent.status, StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(message)));
  };
  const auto mean = v1::DatasetLevel::FILTER_MEAN;
  refuse({0}, mean, "levels.levels[0] is 0");
  refuse({2, 1}, mean, "levels.levels[1] is 1");
  refuse({1, 1}, mean, "levels.levels[1] is 1");
  refuse({3}, mean, "from 1 to 2");
  refuse({2147483647}, mean, "is 2147483647");
  refuse({-1}, mean, "levels.levels[0] is -1");
  refuse({1}, v1::DatasetLevel::FILTER_UNSPECIFIED, "levels.filter is 0");
}

class ChooseLevelTest : public ::testing::Test {
 protected:
  ChooseLevelTest() {
    dataset_.set_name("head");
    grid_.sample_dims = {64, 64, 64};
  }

  std::vector<ServedLevel> Levels(const std::vector<int>& numbers,
                                  LevelFilter filter = LevelFilter::kMean) {
    std::vector<ServedLevel> levels;
    for (const int level : numbers) {
      levels.push_back({.level = level, .filter = filter, .replica_sets = {}});
    }
    return levels;
  }

  // The number of the level, one pixel for a sample of level 0; -1: an error.
  int Choose(const std::vector<ServedLevel>& levels, const volume::InsideRule& rule,
             const view::LevelChoice& choice) {
    const absl::StatusOr<const ServedLevel*> chosen =
        ChooseLevel(levels, dataset_, grid_, {rule}, choice, /*pixels_per_unit=*/1);
    status_ = chosen.status();
    return !chosen.ok() ? -1 : *chosen == nullptr ? 0 : (*chosen)->level;
  }

  static view::LevelChoice Spacing(double px) {
    return {.level = std::nullopt, .max_spacing_px = px};
  }

  v1::Dataset dataset_;
  volume::GridGeometry grid_;
  absl::Status status_;
  const volume::InsideRule isovalue_ = volume::InsideRule::OfIsovalue(3);
  const volume::InsideRule label_ = volume::InsideRule::OfLabels({3});
};

TEST_F(ChooseLevelTest, ALevelThatIsNamedIsServedOrAnError) {
  EXPECT_EQ(Choose(Levels({1, 2}), isovalue_, {.level = 2}), 2);
  EXPECT_EQ(Choose(Levels({1, 2}), isovalue_, {.level = 0}), 0);
  EXPECT_EQ(Choose({}, label_, {.level = 0}), 0);
  EXPECT_EQ(Choose(Levels({1, 2}), isovalue_, {.level = 3}), -1);
  EXPECT_THAT(status_, StatusIs(absl::StatusCode::kFailedPrecondition,
                                AllOf(HasSubstr("level is 3"), HasSubstr("\"head\""),
                                      HasSubstr("levels 0, 1, 2"))));
  EXPECT_THAT(std::string(status_.message()), Not(HasSubstr("a shard lacks it")));
  EXPECT_EQ(Choose(Levels({2}), isovalue_, {.level = 1}), -1);
  EXPECT_THAT(status_, StatusIs(absl::StatusCode::kFailedPrecondition,
                                AllOf(HasSubstr("levels 0, 2"), HasSubstr("a shard lacks it"))));
  EXPECT_EQ(Choose({}, isovalue_, {.level = 1}), -1);
  EXPECT_THAT(status_, StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("--add-levels")));
}

TEST_F(ChooseLevelTest, ASpacingChoosesTheCoarsestServedLevelThatIsFineEnough) {
  EXPECT_EQ(Choose(Levels({1, 2, 3}), isovalue_, Spacing(0.5)), 0);
  EXPECT_EQ(Choose(Levels({1, 2, 3}), isovalue_, Spacing(4)), 2);
  EXPECT_EQ(Choose(Levels({1, 2, 3}), isovalue_, Spacing(1000)), 3);
  EXPECT_EQ(Choose(Levels({1, 3}), isovalue_, Spacing(4)), 1);  // level 2 is not served
  EXPECT_EQ(Choose(Levels({3}), isovalue_, Spacing(4)), 0);
  EXPECT_EQ(Choose({}, isovalue_, Spacing(1000)), 0);
}

TEST_F(ChooseLevelTest, ARuleThatDoesNotFitIsDrawnFromTheSamplesUnlessALevelIsNamed) {
  EXPECT_EQ(Choose(Levels({1}), label_, Spacing(1000)), 0);
  EXPECT_EQ(Choose(Levels({1}, LevelFilter::kMajority), isovalue_, Spacing(1000)), 0);
  EXPECT_EQ(Choose(Levels({1}, LevelFilter::kMajority), label_, Spacing(1000)), 1);
  EXPECT_EQ(Choose(Levels({1}, LevelFilter::kMajority), label_, {.level = 1}), 1);
  EXPECT_EQ(Choose(Levels({1}), label_, {.level = 1}), -1);
  EXPECT_THAT(status_, StatusIs(absl::StatusCode::kFailedPrecondition,
                                AllOf(HasSubstr("surfaces[0]"), HasSubstr("label"))));
  EXPECT_EQ(Choose(Levels({1}, LevelFilter::kMajority), isovalue_, {.level = 1}), -1);
  EXPECT_THAT(status_, StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("isovalue")));
}

}  // namespace
}  // namespace isoscope::server
