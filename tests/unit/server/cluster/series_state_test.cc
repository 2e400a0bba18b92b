#include "server/cluster/series_state.h"

#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "google/protobuf/text_format.h"
#include "gtest/gtest.h"

#include "core/base/check.h"
#include "core/frame/frame_spec.h"
#include "server/cluster/dataset_catalog.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/server/make_shard.h"

namespace isoscope::server {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::IsOk;
using testing::MakeShard;
using testing::SetsOf;
using testing::StatusIs;

namespace v1 = isoscope::v1;
namespace internal = isoscope::internal::v1;

// 32 hex digits that name field, component and step.
std::string IdOf(int field, int component, int step) {
  return absl::StrCat(std::string(26, '0'), field, component, absl::Dec(step, absl::kZeroPad4));
}

void AddComponent(const std::string& name, double min, double max, v1::Field* field) {
  v1::FieldComponent* const component = field->add_components();
  component->set_name(name);
  component->set_sample_type(v1::SAMPLE_TYPE_FLOAT32);
  component->mutable_value_range()->set_min(min);
  component->mutable_value_range()->set_max(max);
}

// A shard of two: pressure (-1 to 1), and velocity with x and magnitude (0 to 9), at times 0, 10,
// 20, ... It has `steps` of both.
internal::ShardDescription Shard(int index, const std::vector<int>& steps, int known_steps = 3) {
  internal::ShardDescription shard = MakeShard("flow", index, 2);
  v1::Dataset* const dataset = shard.mutable_dataset();
  shard.set_manifest_crc32c(0);
  shard.set_range_table_crc32c(0);
  v1::Field* const pressure = dataset->add_fields();
  pressure->set_name("pressure");
  AddComponent("", -1, 1, pressure);
  v1::Field* const velocity = dataset->add_fields();
  velocity->set_name("velocity");
  AddComponent("x", -4, 4, velocity);
  AddComponent("magnitude", 0, 9, velocity);
  for (int step = 0; step < known_steps; ++step) {
    v1::TimeStep* const time = dataset->add_time_steps();
    time->set_number(step);
    time->set_value(10 * step);
  }
  for (const int step : steps) {
    for (const auto& [field, component] : {std::pair(0, 0), {1, 0}, {1, 1}}) {
      internal::VolumeDescription* const volume = shard.add_volumes();
      volume->set_field_index(field);
      volume->set_component_index(component);
      volume->set_step_number(step);
      volume->set_dataset_id(IdOf(field, component, step));
    }
  }
  return shard;
}

AgentState Agent(const std::string& address, std::vector<internal::ShardDescription> shards) {
  AgentState state;
  state.address = address;
  internal::DescribeShardsResponse answer;
  answer.mutable_picture_revision()->set_number(1);
  answer.mutable_picture_revision()->set_back_end(internal::PictureRevision::BACK_END_CPU);
  for (internal::ShardDescription& shard : shards) {
    *answer.add_shards() = std::move(shard);
  }
  AdoptAnswer(std::move(answer), &state);
  ISOSCOPE_CHECK(state.status.ok());
  return state;
}

std::shared_ptr<const DatasetState> Flow(const std::vector<AgentState>& agents) {
  return std::make_shared<DatasetState>(DatasetsOf(agents).at("flow"));
}

v1::FieldSelection Selection(const std::string& text) {
  v1::FieldSelection selection;
  ISOSCOPE_CHECK(google::protobuf::TextFormat::ParseFromString(text, &selection));
  return selection;
}

absl::StatusOr<SelectedVolume> Select(const std::shared_ptr<const DatasetState>& dataset,
                                      const std::string& text) {
  const v1::FieldSelection selection = Selection(text);
  std::vector<frame::Surface> no_surfaces;
  return SelectVolume(dataset, &selection, &no_surfaces);
}

std::vector<int> StepsOf(const v1::Dataset& dataset) {
  std::vector<int> steps;
  for (const v1::TimeStep& step : dataset.time_steps()) {
    steps.push_back(step.number());
  }
  return steps;
}

TEST(SeriesStateTest, AStepIsOfferedOnceAllShardsHaveIt) {
  const auto flow = Flow({Agent("a:1", {Shard(0, {0, 1, 2})}), Agent("b:1", {Shard(1, {0, 1})})});
  EXPECT_THAT(flow->status, IsOk());
  EXPECT_THAT(StepsOf(flow->dataset), ElementsAre(0, 1));
  EXPECT_THAT(flow->dataset.fields(1).time_steps(), ElementsAre(0, 1));
  EXPECT_THAT(Select(flow, "time_step: 2"),
              StatusIs(absl::StatusCode::kNotFound,
                       AllOf(HasSubstr("time_step is 2"), HasSubstr("steps 0 to 1"))));
  const auto later =
      Flow({Agent("a:1", {Shard(0, {0, 1, 2})}), Agent("b:1", {Shard(1, {0, 1, 2})})});
  EXPECT_THAT(StepsOf(later->dataset), ElementsAre(0, 1, 2));
}

// Symptom: colours of one step had the range of all, in which it is a few shades.
TEST(SeriesStateTest, AStepHasItsOwnRanges) {
  const auto with_ranges = [](internal::ShardDescription shard) {
    for (internal::VolumeDescription& volume : *shard.mutable_volumes()) {
      volume.mutable_value_range()->set_min(volume.component_index());
      volume.mutable_value_range()->set_max(volume.step_number() + 2);
      volume.set_max_gradient_magnitude(3 + volume.step_number());
    }
    return shard;
  };
  const auto flow = Flow({Agent("a:1", {with_ranges(Shard(0, {0, 1}))}),
                          Agent("b:1", {with_ranges(Shard(1, {0, 1}))})});
  const frame::ColorBy by_magnitude{
      .quantity = frame::ColorBy::Quantity::kField, .field = "velocity", .component = "magnitude"};
  for (const int step : {0, 1}) {
    std::vector<frame::Surface> surfaces(3);
    surfaces[0].color_by = surfaces[1].color_by = surfaces[2].color_by = by_magnitude;
    surfaces[1].color_by->range_source = frame::RangeSource::kStep;
    surfaces[2].color_by->range_source = frame::RangeSource::kVisible;
    const v1::FieldSelection selection = Selection(absl::StrCat("time_step: ", step));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SelectedVolume selected,
                                  SelectVolume(flow, &selection, &surfaces));
    EXPECT_EQ(selected.at_step.value_range().max(), step + 2);
    EXPECT_EQ(selected.at_step.max_gradient_magnitude(), step + 3);
    EXPECT_EQ(selected.dataset->dataset.value_range().max(), 1) << "over all steps";
    EXPECT_EQ(surfaces[0].color_by->range, (frame::ColorRange{0, 9}));
    EXPECT_EQ(surfaces[1].color_by->range, (frame::ColorRange{1, step + 2.0}));
    EXPECT_EQ(surfaces[2].color_by->range, (frame::ColorRange{0, 9}));
    EXPECT_EQ(surfaces[2].color_by->range_source, frame::RangeSource::kVisible);
  }
}

// Series with one dataset id may differ in later steps.
TEST(SeriesStateTest, TheDigestOfAStepTellsItsVolumes) {
  const auto digests_of = [](const std::vector<internal::ShardDescription>& shards) {
    const auto flow = Flow({Agent("a:1", shards)});
    std::vector<std::string> digests;
    for (const v1::TimeStep& step : flow->dataset.time_steps()) {
      digests.push_back(step.volumes_digest());
    }
    return digests;
  };
  const std::vector<std::string> digests = digests_of({Shard(0, {0, 1, 2}), Shard(1, {0, 1, 2})});
  ASSERT_EQ(digests.size(), 3U);
  for (const std::string& digest : digests) {
    EXPECT_THAT(digest, ::testing::MatchesRegex("[0-9a-f]{32}"));
  }
  EXPECT_NE(digests[0], digests[1]);
  const std::vector<std::string> fewer = digests_of({Shard(0, {0, 1}), Shard(1, {0, 1, 2})});
  EXPECT_THAT(fewer, ElementsAre(digests[0], digests[1]));
  std::vector<internal::ShardDescription> other = {Shard(0, {0, 1, 2}), Shard(1, {0, 1, 2})};
  for (internal::ShardDescription& shard : other) {
    shard.mutable_volumes(2 * 3 + 1)->set_dataset_id(IdOf(9, 9, 9));  // velocity x, step 2
  }
  const std::vector<std::string> changed = digests_of(other);
  EXPECT_THAT(changed, ElementsAre(digests[0], digests[1], ::testing::Ne(digests[2])));
}

TEST(SeriesStateTest, AnAgentThatLagsIsNotUsedForTheNewStepAndIsForTheOthers) {
  // The second one has an older manifest, too.
  const auto flow = Flow({Agent("a:1", {Shard(0, {0, 1, 2}), Shard(1, {0, 1, 2})}),
                          Agent("b:1", {Shard(0, {0, 1}, 2), Shard(1, {0, 1}, 2)})});
  ASSERT_THAT(flow->status, IsOk());
  EXPECT_EQ(flow->contradiction, "") << "appending is no contradiction";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SelectedVolume old, Select(flow, "time_step: 1"));
  EXPECT_THAT(SetsOf(*old.dataset), ElementsAre("0,1: a:1 b:1"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SelectedVolume newest, Select(flow, "time_step: -1"));
  EXPECT_THAT(SetsOf(*newest.dataset), ElementsAre("0,1: a:1"));
  EXPECT_EQ(newest.selection->time_step(), 2);
  EXPECT_EQ(newest.time, 20);
}

struct Choice {
  const char* asked;
  const char* used;  // "": the default of a request without a selection
  int field;
  int component;
};

class SelectionTest : public ::testing::TestWithParam<Choice> {};

TEST_P(SelectionTest, ResolvesToOneVolume) {
  const auto flow = Flow({Agent("a:1", {Shard(0, {0, 1, 2}), Shard(1, {0, 1, 2})})});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SelectedVolume selected, Select(flow, GetParam().asked));
  const v1::FieldSelection used = Selection(GetParam().used);
  EXPECT_EQ(selected.selection->DebugString(), used.DebugString());
  EXPECT_EQ(selected.dataset->dataset.dataset_id(),
            IdOf(GetParam().field, GetParam().component, used.time_step()));
  EXPECT_EQ(selected.dataset->dataset.value_range().DebugString(),
            flow->dataset.fields(GetParam().field)
                .components(GetParam().component)
                .value_range()
                .DebugString());
  EXPECT_TRUE(selected.dataset->dataset.fields().empty());
}

INSTANTIATE_TEST_SUITE_P(
    Table, SelectionTest,
    ::testing::Values(
        Choice{"", "field: 'pressure' time_step: 2", 0, 0},
        Choice{"field: 'velocity'", "field: 'velocity' component: 'magnitude' time_step: 2", 1, 1},
        Choice{"field: 'velocity' component: 'x' time_step: 0",
               "field: 'velocity' component: 'x' time_step: 0", 1, 0},
        Choice{"field: 'velocity' component: '0' time_step: 1",
               "field: 'velocity' component: 'x' time_step: 1", 1, 0},
        Choice{"time: 14.9", "field: 'pressure' time_step: 1", 0, 0},
        Choice{"time: 15", "field: 'pressure' time_step: 1", 0, 0},  // the earlier of two
        Choice{"time: 15.1", "field: 'pressure' time_step: 2", 0, 0},
        Choice{"time: -1e300", "field: 'pressure' time_step: 0", 0, 0},
        Choice{"time: 1e300", "field: 'pressure' time_step: 2", 0, 0}));

TEST(SeriesStateTest, AChoiceThatThereIsNotNamesThoseThatThereAre) {
  const auto flow = Flow({Agent("a:1", {Shard(0, {0, 2}), Shard(1, {0, 2})})});
  EXPECT_THAT(Select(flow, "field: 'heat'"),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("\"heat\""), HasSubstr("\"pressure\", \"velocity\""))));
  EXPECT_THAT(Select(flow, "field: 'velocity' component: 'w'"),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("\"w\""), HasSubstr("\"x\", \"magnitude\""))));
  EXPECT_THAT(Select(flow, "field: 'velocity' component: '1'"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("\"1\"")))
      << "the magnitude has no number";
  // The component may stand behind the name.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SelectedVolume x, Select(flow, "field: 'velocity:x'"));
  EXPECT_EQ(x.selection->field(), "velocity");
  EXPECT_EQ(x.selection->component(), "x");
  EXPECT_THAT(Select(flow, "field: 'velocity:x' component: 'magnitude'"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("\"velocity:x\"")));
  EXPECT_THAT(Select(flow, "component: '0'"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("one component")));
  EXPECT_THAT(Select(flow, "time_step: 1"),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("steps 0, 2")));
  EXPECT_THAT(Select(flow, "time: nan"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("must be finite")));
}

TEST(SeriesStateTest, ADatasetWithoutFieldsHasTheFirstAndTheLastStepAndNothingElseToChoose) {
  const auto head = std::make_shared<DatasetState>(
      DatasetsOf({Agent("a:1", {MakeShard("head", 0, 1)})}).at("head"));
  for (const char* only : {"time_step: 0", "time_step: -1", ""}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SelectedVolume only_volume, Select(head, only));
    EXPECT_EQ(only_volume.dataset, head);
    EXPECT_FALSE(only_volume.selection.has_value());
  }
  EXPECT_THAT(Select(head, "time_step: 1"),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("step 0 alone")));
  EXPECT_THAT(Select(head, "time: 0"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("has no times")));
  EXPECT_THAT(Select(head, "field: 'heat'"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("one field")));
  EXPECT_THAT(Select(head, "component: 'x'"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("selection.component")));
  std::vector<frame::Surface> surfaces;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SelectedVolume selected,
                                SelectVolume(head, nullptr, &surfaces));
  EXPECT_EQ(selected.dataset, head);
  EXPECT_FALSE(selected.selection.has_value());
  surfaces.push_back({.color_by = frame::ColorBy{.quantity = frame::ColorBy::Quantity::kField}});
  EXPECT_THAT(SelectVolume(head, nullptr, &surfaces),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("surfaces[0].color_by")));
}

TEST(SeriesStateTest, ColoursNameTheVolumeOfTheSameStepAndItsRangeOverAllSteps) {
  const auto flow = Flow({Agent("a:1", {Shard(0, {0, 1}), Shard(1, {0, 1})})});
  std::vector<frame::Surface> surfaces;
  surfaces.emplace_back();
  frame::ColorBy color_by{.quantity = frame::ColorBy::Quantity::kField, .field = "velocity"};
  surfaces.push_back({.color_by = color_by});
  color_by.range = frame::ColorRange{2, 3};
  surfaces.push_back({.color_by = color_by});
  const v1::FieldSelection selection = Selection("time_step: 0");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SelectedVolume selected,
                                SelectVolume(flow, &selection, &surfaces));
  EXPECT_THAT(selected.color_dataset_ids, ElementsAre("", IdOf(1, 1, 0), IdOf(1, 1, 0)));
  EXPECT_EQ(surfaces[1].color_by->range, (frame::ColorRange{0, 9}));
  EXPECT_EQ(surfaces[2].color_by->range, (frame::ColorRange{2, 3}));
  surfaces[1].color_by->field = "heat";
  EXPECT_THAT(SelectVolume(flow, &selection, &surfaces),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("surfaces[1].color_by.field"), HasSubstr("\"heat\""))));
}

TEST(SeriesStateTest, AFrameOfTwoFieldsNeedsAgentsThatHaveBoth) {
  // Each shard has each field somewhere, but nobody has both of shard 1.
  internal::ShardDescription pressure = Shard(1, {0});
  pressure.mutable_volumes()->DeleteSubrange(1, 2);
  internal::ShardDescription velocity = Shard(1, {0});
  velocity.mutable_volumes()->DeleteSubrange(0, 1);
  const auto flow = Flow({Agent("a:1", {Shard(0, {0}), pressure}), Agent("b:1", {velocity})});
  ISOSCOPE_ASSERT_OK(Select(flow, "field: 'velocity'").status());
  std::vector<frame::Surface> surfaces(1);
  surfaces[0].color_by = {.quantity = frame::ColorBy::Quantity::kField, .field = "velocity"};
  EXPECT_THAT(SelectVolume(flow, nullptr, &surfaces),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr("shard 1")));
}

TEST(SeriesStateTest, AllFieldsAreThoseOfTheStepOnAgentsThatHaveThemAll) {
  const std::vector<frame::Surface> none;
  const auto select = [&](const std::shared_ptr<const DatasetState>& dataset,
                          const std::string& text) {
    auto surfaces = none;
    const v1::FieldSelection selection = Selection(text);
    return SelectVolume(dataset, &selection, &surfaces, /*with_all_fields=*/true);
  };
  const auto flow = Flow({Agent("a:1", {Shard(0, {0, 1}), Shard(1, {0, 1})})});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SelectedVolume selected,
                                select(flow, "field: 'velocity' time_step: 0"));
  std::vector<std::string> fields;
  for (const FieldVolume& field : selected.all_fields) {
    fields.push_back(absl::StrCat(field.field, ":", field.component, " ", field.dataset_id));
  }
  EXPECT_THAT(fields, ElementsAre("pressure: " + IdOf(0, 0, 0), "velocity:x " + IdOf(1, 0, 0),
                                  "velocity:magnitude " + IdOf(1, 1, 0)));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SelectedVolume without, Select(flow, ""));
  EXPECT_TRUE(without.all_fields.empty());

  // One agent lags with a field, at the only step that the other field has.
  internal::ShardDescription pressure = Shard(1, {0});
  pressure.mutable_volumes()->DeleteSubrange(1, 2);
  const auto lagging =
      Flow({Agent("a:1", {Shard(0, {0}), pressure}), Agent("b:1", {Shard(1, {0})})});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SelectedVolume of_both, select(lagging, ""));
  EXPECT_THAT(SetsOf(*of_both.dataset), ElementsAre("0: a:1", "1: b:1"));
  const auto missing = Flow({Agent("a:1", {Shard(0, {0}), pressure})});
  EXPECT_THAT(select(missing, ""),
              StatusIs(absl::StatusCode::kNotFound,
                       HasSubstr("with_field_values: field is \"velocity\": served at steps none, "
                                 "the surfaces are of step 0")));
  internal::ShardDescription velocity = Shard(1, {0});
  velocity.mutable_volumes()->DeleteSubrange(0, 1);
  EXPECT_THAT(
      select(Flow({Agent("a:1", {Shard(0, {0}), pressure}), Agent("b:1", {velocity})}), ""),
      StatusIs(absl::StatusCode::kUnavailable, HasSubstr("no agent has all fields for shard 1")));
  const auto head = std::make_shared<DatasetState>(
      DatasetsOf({Agent("a:1", {MakeShard("head", 0, 1)})}).at("head"));
  auto surfaces = none;
  EXPECT_THAT(SelectVolume(head, nullptr, &surfaces, /*with_all_fields=*/true),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       HasSubstr("with_field_values is set: dataset \"head\" has one field")));
}

TEST(SeriesStateTest, OfTwoVolumesOfOneKeyThatOfMostAgentsIsTaken) {
  internal::ShardDescription other[] = {Shard(0, {0}), Shard(1, {0})};
  for (internal::ShardDescription& shard : other) {
    shard.mutable_volumes(0)->set_dataset_id(std::string(32, 'f'));
  }
  const std::vector<internal::ShardDescription> usual = {Shard(0, {0}), Shard(1, {0})};
  const auto flow =
      Flow({Agent("a:1", {other[0], other[1]}), Agent("b:1", usual), Agent("c:1", usual)});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SelectedVolume selected, Select(flow, ""));
  EXPECT_EQ(selected.dataset->dataset.dataset_id(), IdOf(0, 0, 0));
  EXPECT_THAT(SetsOf(*selected.dataset), ElementsAre("0,1: b:1 c:1"));
}

TEST(SeriesStateTest, VolumesOfNoFieldOrStepAreRefused) {
  for (const auto& [field, component, step] :
       {std::tuple(2, 0, 0), {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 3}, {0, 0, -1}}) {
    internal::DescribeShardsResponse answer;
    answer.mutable_picture_revision()->set_number(1);
    answer.mutable_picture_revision()->set_back_end(internal::PictureRevision::BACK_END_CPU);
    *answer.add_shards() = Shard(0, {0});
    internal::VolumeDescription* const volume = answer.mutable_shards(0)->add_volumes();
    volume->set_field_index(field);
    volume->set_component_index(component);
    volume->set_step_number(step);
    AgentState state;
    AdoptAnswer(answer, &state);
    EXPECT_THAT(state.status,
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("shards[0].volumes[3]")));
  }
}

// Levels are those of the drawn volume, if the volumes that colour its surfaces have them, too.
TEST(SeriesStateTest, AFrameHasTheLevelsThatAllOfItsVolumesHave) {
  const auto with_levels = [](internal::ShardDescription shard) {
    for (internal::VolumeDescription& volume : *shard.mutable_volumes()) {
      volume.mutable_levels()->set_filter(v1::DatasetLevel::FILTER_MEAN);
      volume.mutable_levels()->add_levels(1);
      if (volume.field_index() == 0) {
        volume.mutable_levels()->add_levels(2);
      }
    }
    return shard;
  };
  const auto flow = Flow({Agent("a:1", {with_levels(Shard(0, {0, 1}))}),
                          Agent("b:1", {with_levels(Shard(1, {0, 1}))})});
  const auto levels_of = [](const SelectedVolume& selected) {
    std::vector<int> levels;
    for (const ServedLevel& level : selected.dataset->levels) {
      levels.push_back(level.level);
    }
    return levels;
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SelectedVolume pressure,
                                Select(flow, "field: \"pressure\" time_step: 1"));
  EXPECT_THAT(levels_of(pressure), ElementsAre(1, 2));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SelectedVolume velocity, Select(flow, "field: \"velocity\""));
  EXPECT_THAT(levels_of(velocity), ElementsAre(1));
  std::vector<frame::Surface> surfaces(1);
  surfaces[0].color_by = frame::ColorBy{
      .quantity = frame::ColorBy::Quantity::kField, .field = "velocity", .component = "magnitude"};
  const v1::FieldSelection selection = Selection("field: \"pressure\"");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SelectedVolume colored,
                                SelectVolume(flow, &selection, &surfaces));
  EXPECT_THAT(levels_of(colored), ElementsAre(1));
  ASSERT_EQ(flow->dataset.levels_size(), 2);  // of the default field
  EXPECT_EQ(flow->dataset.levels(1).level(), 2);
}

}  // namespace
}  // namespace isoscope::server
