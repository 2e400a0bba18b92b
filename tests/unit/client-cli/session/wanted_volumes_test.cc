#include "client-cli/session/wanted_volumes.h"

#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"
#include "tests/unit/core/partition/series_fixture.h"

namespace isoscope::cli {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Pair;
using testing::StatusIs;
using ::testing::UnorderedElementsAre;

// Fields p, u (x, y, z) and one with colons in its name; steps 0 to 3 at 0, 1, 2 and 4 s.
partition::MemorySeries Flow() {
  std::vector<source::SourceField> fields = partition::FlowFields();
  fields.push_back({.name = "u:x:rms"});
  return partition::MemorySeries(std::move(fields), {0, 1, 2, 4});
}

WantedVolumes WithField(const std::string& name) {
  return {.selection = {.field = client::FieldValue{.name = name}}};
}

std::set<std::pair<int, int>> VolumesOf(const WantedVolumes& wanted) {
  const absl::StatusOr<ChosenVolumes> chosen = ChooseVolumes(wanted, Flow());
  ISOSCOPE_EXPECT_OK(chosen);
  return chosen.ok() ? chosen->volumes : std::set<std::pair<int, int>>();
}

std::string NoteOf(const WantedVolumes& wanted) {
  const absl::StatusOr<ChosenVolumes> chosen = ChooseVolumes(wanted, Flow());
  ISOSCOPE_EXPECT_OK(chosen);
  return chosen.ok() ? chosen->note : "";
}

TEST(WantedVolumesTest, WithoutAChoiceItIsTheFirstFieldAtTheLastStep) {
  const absl::StatusOr<ChosenVolumes> chosen = ChooseVolumes({}, Flow());
  ISOSCOPE_ASSERT_OK(chosen);
  EXPECT_THAT(chosen->volumes, ElementsAre(Pair(0, 3)));
  EXPECT_THAT(chosen->fields, ElementsAre("p"));
  EXPECT_EQ(chosen->text, "");
}

TEST(WantedVolumesTest, TheNoteTellsWhatNoFlagChose) {
  EXPECT_THAT(NoteOf({}), AllOf(HasSubstr("field \"p\" of p [Pa], u [m/s] (x, y, z), u:x:rms"),
                                HasSubstr("step 3 of 0 to 3"), HasSubstr("--field and --step")));
  EXPECT_EQ(NoteOf(WithField("u")), "takes step 3 of 0 to 3; --step chooses");
  EXPECT_THAT(NoteOf({.selection = {.step = -1}}),
              AllOf(HasSubstr("field \"p\""), HasSubstr("--field chooses")));
  WantedVolumes both = WithField("u");
  both.selection.time = 1;
  EXPECT_EQ(NoteOf(both), "");
}

TEST(WantedVolumesTest, TakesTheStepThatIsNamed) {
  EXPECT_THAT(VolumesOf({.selection = {.step = 0}}), ElementsAre(Pair(0, 0)));
  EXPECT_THAT(VolumesOf({.selection = {.step = -1}}), ElementsAre(Pair(0, 3)));
}

TEST(WantedVolumesTest, RefusesAStepThatIsNotThere) {
  EXPECT_THAT(ChooseVolumes({.selection = {.step = 4}}, Flow()),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("steps 0 to 3")));
  EXPECT_THAT(ChooseVolumes({.selection = {.step = 1}},
                            partition::MemorySeries(partition::FlowFields(), {})),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("step 0 alone")));
}

TEST(WantedVolumesTest, OfTwoStepsThatAreEquallyNearTheEarlierIsTaken) {
  EXPECT_THAT(VolumesOf({.selection = {.time = -5}}), ElementsAre(Pair(0, 0)));
  EXPECT_THAT(VolumesOf({.selection = {.time = 0.5}}), ElementsAre(Pair(0, 0)));
  EXPECT_THAT(VolumesOf({.selection = {.time = 0.51}}), ElementsAre(Pair(0, 1)));
  EXPECT_THAT(VolumesOf({.selection = {.time = 2}}), ElementsAre(Pair(0, 2)));
  EXPECT_THAT(VolumesOf({.selection = {.time = 3}}), ElementsAre(Pair(0, 2)));
  EXPECT_THAT(VolumesOf({.selection = {.time = 3.1}}), ElementsAre(Pair(0, 3)));
  EXPECT_THAT(VolumesOf({.selection = {.time = 99}}), ElementsAre(Pair(0, 3)));
}

TEST(WantedVolumesTest, RefusesATimeForASourceWithoutTimes) {
  EXPECT_THAT(ChooseVolumes({.selection = {.time = 1}},
                            partition::MemorySeries(partition::FlowFields(), {})),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("without a time")));
}

TEST(WantedVolumesTest, TakesTheFieldThatIsNamedAlsoByAComponent) {
  EXPECT_THAT(VolumesOf(WithField("u")), ElementsAre(Pair(1, 3)));
  EXPECT_THAT(VolumesOf(WithField("u:y")), ElementsAre(Pair(1, 3)));
  EXPECT_THAT(VolumesOf(WithField("u:2")), ElementsAre(Pair(1, 3)));
  EXPECT_THAT(VolumesOf(WithField("u:magnitude")), ElementsAre(Pair(1, 3)));
}

TEST(WantedVolumesTest, AnExactNameWithColonsComesFirst) {
  EXPECT_THAT(VolumesOf(WithField("u:x:rms")), ElementsAre(Pair(2, 3)));
}

TEST(WantedVolumesTest, FieldOnAnotherGridIsNamedWithThePathThatOpensIt) {
  source::SeriesInfo info = Flow().info();
  info.name = "run.nc";
  info.fields_elsewhere = {"q"};
  partition::MemorySeries flow(info);
  for (const char* field : {"q", "q:x"}) {
    EXPECT_THAT(ChooseVolumes(WithField(field), flow),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         HasSubstr("it lies on another grid: open run.nc:q")));
  }
}

TEST(WantedVolumesTest, RefusesAFieldOrComponentThatIsNotThere) {
  EXPECT_THAT(ChooseVolumes(WithField("q"), Flow()),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("no field \"q\""), HasSubstr("u [m/s] (x, y, z)"))));
  EXPECT_THAT(ChooseVolumes(WithField("u:3"), Flow()),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("x, y, z and magnitude")));
  EXPECT_THAT(ChooseVolumes(WithField("p:magnitude"), Flow()),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("one, without a name")));
  EXPECT_THAT(ChooseVolumes({.selection = {.component = "z"}}, Flow()),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no component \"z\"")));
}

TEST(WantedVolumesTest, ANearFieldIsSuggestedForOneThatIsNotThere) {
  source::SeriesInfo info = Flow().info();
  info.fields[0].name = "pressure";
  partition::MemorySeries flow(info);
  for (const char* field : {"presure", "presure:x"}) {
    EXPECT_THAT(ChooseVolumes(WithField(field), flow),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         AllOf(HasSubstr(field), HasSubstr("did you mean \"pressure\"?"))));
  }
  EXPECT_THAT(
      ChooseVolumes(WithField("entropy"), flow),
      StatusIs(absl::StatusCode::kInvalidArgument, ::testing::Not(HasSubstr("did you mean"))));
}

TEST(WantedVolumesTest, ASweepTakesItsStepsInPlaceOfTheSelections) {
  int count = 0;
  const WantedVolumes sweep{.steps = [&](int step_count) {
    count = step_count;
    return absl::StatusOr<std::vector<int>>(std::vector<int>{1, 3});
  }};
  EXPECT_FALSE(sweep.is_default());
  EXPECT_THAT(VolumesOf(sweep), ElementsAre(Pair(0, 1), Pair(0, 3)));
  EXPECT_EQ(count, 4);
}

TEST(WantedVolumesTest, ColorsOfAnotherFieldHaveTheRangeOfAllSteps) {
  EXPECT_THAT(
      VolumesOf({.selection = {.step = 1}, .colors = {{.text = "u:x", .needs_all_steps = true}}}),
      UnorderedElementsAre(Pair(0, 1), Pair(1, 0), Pair(1, 1), Pair(1, 2), Pair(1, 3)));
}

TEST(WantedVolumesTest, ColorsWithARangeNeedTheStepAlone) {
  EXPECT_THAT(VolumesOf({.selection = {.step = 1}, .colors = {{.text = "u:x"}}}),
              UnorderedElementsAre(Pair(0, 1), Pair(1, 1)));
}

TEST(WantedVolumesTest, RefusesColorsOfAFieldThatIsNotThere) {
  EXPECT_THAT(ChooseVolumes({.colors = {{.text = "q"}}}, Flow()),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no field \"q\"")));
}

TEST(WantedVolumesTest, AllFieldsAtTheStepAndAllStepsOfTheField) {
  EXPECT_THAT(VolumesOf({.selection = {.step = 2}, .needs_all_fields = true}),
              UnorderedElementsAre(Pair(0, 2), Pair(1, 2), Pair(2, 2)));
  EXPECT_THAT(VolumesOf({.selection = {.step = 2}, .needs_all_steps = true}),
              UnorderedElementsAre(Pair(0, 0), Pair(0, 1), Pair(0, 2), Pair(0, 3)));
}

TEST(WantedVolumesTest, EachChoiceHasATextOfItsOwn) {
  std::set<std::string> texts;
  int count = 0;
  for (const WantedVolumes& wanted :
       {WantedVolumes{}, WithField("u"), WithField("u:x:rms"),
        WantedVolumes{.selection = {.step = 0}}, WantedVolumes{.selection = {.step = 1}},
        WantedVolumes{.needs_all_steps = true}, WantedVolumes{.needs_all_fields = true}}) {
    const absl::StatusOr<ChosenVolumes> chosen = ChooseVolumes(wanted, Flow());
    ISOSCOPE_ASSERT_OK(chosen);
    texts.insert(chosen->text);
    ++count;
  }
  texts.insert(ChooseAllVolumes(Flow()).text);
  EXPECT_EQ(texts.size(), count + 1);
}

TEST(WantedVolumesTest, WaysToOneChoiceShareItsText) {
  // The last step by its number, its name and its time.
  for (const client::SelectionFlags& selection :
       {client::SelectionFlags{.step = 3}, client::SelectionFlags{.step = -1},
        client::SelectionFlags{.time = 4}, client::SelectionFlags{.field = {{.name = "p"}}}}) {
    const absl::StatusOr<ChosenVolumes> chosen = ChooseVolumes({.selection = selection}, Flow());
    ISOSCOPE_ASSERT_OK(chosen);
    EXPECT_EQ(chosen->text, "");
  }
  EXPECT_EQ(ChooseVolumes(WithField("u:x"), Flow())->text,
            ChooseVolumes(WithField("u:y"), Flow())->text);
}

TEST(WantedVolumesTest, AllVolumes) {
  const ChosenVolumes all = ChooseAllVolumes(Flow());
  EXPECT_EQ(all.volumes.size(), 12);
  EXPECT_THAT(all.fields, ElementsAre("p", "u", "u:x:rms"));
  EXPECT_EQ(all.note, "");
}

class AddColorsTest : public ::testing::Test {
 protected:
  WantedVolumes Wanted() const {
    WantedVolumes wanted;
    AddColors(look_, caps_, &wanted);
    return wanted;
  }

  client::LookFlags look_;
  std::optional<frame::ClipCaps> caps_;
};

TEST_F(AddColorsTest, AFieldWithoutARangeNeedsAllSteps) {
  look_.color_by = {{.color_by = frame::ColorBy{}, .field = "u:x"}};
  const WantedVolumes wanted = Wanted();
  ASSERT_EQ(wanted.colors.size(), 1);
  EXPECT_EQ(wanted.colors[0].text, "u:x");
  EXPECT_TRUE(wanted.colors[0].needs_all_steps);
  EXPECT_FALSE(wanted.needs_all_steps);
}

TEST_F(AddColorsTest, AFieldWithARangeNeedsTheStepsThatAreDrawn) {
  look_.color_by = {
      {.color_by = frame::ColorBy{.range = frame::ColorRange{.min = 0, .max = 1}}, .field = "u"}};
  EXPECT_FALSE(Wanted().colors.at(0).needs_all_steps);
}

TEST_F(AddColorsTest, TheGradientWithoutARangeNeedsAllStepsOfTheField) {
  look_.color_by = {
      {.color_by = frame::ColorBy{.quantity = frame::ColorBy::Quantity::kGradientMagnitude}}};
  EXPECT_TRUE(Wanted().needs_all_steps);
  EXPECT_THAT(Wanted().colors, IsEmpty());
}

TEST_F(AddColorsTest, CapsNeedAllStepsWhereTheyHaveNeitherARangeNorAWindow) {
  caps_ = frame::ClipCaps{.map = frame::ColorMap::kViridis};
  EXPECT_FALSE(Wanted().needs_all_steps) << "render asks for the window of the step";
  look_.color_range = frame::RangeSource::kAllSteps;
  EXPECT_TRUE(Wanted().needs_all_steps);
  look_.cap_window = client::CapWindow{.percentiles = frame::Percentiles()};
  EXPECT_FALSE(Wanted().needs_all_steps);
  look_.cap_window = client::CapWindow();
  EXPECT_TRUE(Wanted().needs_all_steps);
  caps_->range = frame::ColorRange{.min = 0, .max = 1};
  EXPECT_FALSE(Wanted().needs_all_steps);
}

TEST_F(AddColorsTest, TheRangeOfTheStepNeedsNoOtherStep) {
  caps_ = frame::ClipCaps{.map = frame::ColorMap::kViridis};
  look_.color_by = {
      {.color_by = frame::ColorBy{}, .field = "u"},
      {.color_by = frame::ColorBy{.quantity = frame::ColorBy::Quantity::kGradientMagnitude}}};
  look_.color_range = frame::RangeSource::kStep;
  EXPECT_FALSE(Wanted().colors.at(0).needs_all_steps);
  EXPECT_FALSE(Wanted().needs_all_steps);
  look_.color_range = frame::RangeSource::kVisible;
  EXPECT_TRUE(Wanted().colors.at(0).needs_all_steps) << "it is found within that of all steps";
  EXPECT_TRUE(Wanted().needs_all_steps);
}

}  // namespace
}  // namespace isoscope::cli
