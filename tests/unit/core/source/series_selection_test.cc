#include "core/source/series_selection.h"

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/unit/core/partition/series_fixture.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using partition::FlowFields;
using partition::MemorySeries;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::unique_ptr<MemorySeries> Flow(std::vector<double> times) {
  return std::make_unique<MemorySeries>(FlowFields(), std::move(times));
}

std::unique_ptr<MemorySeries> Nameless() {
  return std::make_unique<MemorySeries>(
      std::vector<SourceField>{
          {.name = "file_0042", .long_name = "", .unit = "", .components = {""}}},
      std::vector<double>{});
}

std::string SamplesAt(VolumeSeries& series, int field, int component, int step) {
  const auto volume = series.Open(field, component, step).value();
  const math::Index3& dims = volume->info().geometry.sample_dims;
  std::string bytes(static_cast<std::size_t>(math::Volume(dims)) * 4, '\0');
  EXPECT_THAT(volume->ReadRows(0, dims.y * dims.z, bytes.data()), testing::IsOk());
  return bytes;
}

TEST(SeriesSelectionTest, TakesFieldsAndStepsInTheOrderThatWasAsked) {
  const auto all = Flow({0, 1, 2, 3, 4});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto chosen,
      SelectFrom(Flow({0, 1, 2, 3, 4}), {.fields = {"u", "p"},
                                         .names_field = false,
                                         .steps = StepRange{.first = 1, .last = 4, .stride = 2},
                                         .time = std::nullopt}));
  ASSERT_EQ(chosen->info().fields.size(), 2);
  EXPECT_EQ(chosen->info().fields[0].name, "u");
  EXPECT_EQ(chosen->info().fields[1].long_name, "pressure");
  EXPECT_THAT(chosen->info().times, ElementsAre(1, 3));
  EXPECT_EQ(chosen->info().step_count(), 2);
  EXPECT_EQ(chosen->info().time_unit, "s");
  EXPECT_EQ(chosen->info().length_unit, "m");
  EXPECT_EQ(SamplesAt(*chosen, 0, 2, 1), SamplesAt(*all, 1, 2, 3));
  EXPECT_EQ(SamplesAt(*chosen, 1, 0, 0), SamplesAt(*all, 0, 0, 1));
}

TEST(SeriesSelectionTest, TakesAllByDefault) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto chosen, SelectFrom(Flow({0, 1}), {}));
  EXPECT_EQ(chosen->info().fields.size(), 2);
  EXPECT_THAT(chosen->info().times, ElementsAre(0, 1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto timeless, SelectFrom(Flow({}), {}));
  EXPECT_TRUE(timeless->info().times.empty());
}

TEST(SeriesSelectionTest, GivesANameAndATimeToWhatHasNone) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto named,
      SelectFrom(Nameless(),
                 {.fields = {"p"}, .names_field = true, .steps = std::nullopt, .time = 4.5}));
  EXPECT_EQ(named->info().fields[0].name, "p");
  EXPECT_THAT(named->info().times, ElementsAre(4.5));
}

TEST(SeriesSelectionTest, SaysWhatThereIs) {
  const auto expect_error = [](std::unique_ptr<MemorySeries> source, SeriesSelection selection,
                               const char* message) {
    EXPECT_THAT(SelectFrom(std::move(source), selection),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(message)));
  };
  SeriesSelection selection;
  selection.fields = {"q"};
  expect_error(Flow({0}), selection, "no field \"q\"; it has \"p\", \"u\"");
  selection.fields = {"p", "p"};
  expect_error(Flow({0}), selection, "given twice");
  selection.fields = {"a", "b"};
  selection.names_field = true;
  expect_error(Nameless(), selection, "the names of 2 were given");
  selection = {};
  selection.steps = StepRange{.first = 0, .last = 2, .stride = 1};
  expect_error(Flow({0, 1}), selection, "step 2: the source has steps 0 to 1");
  selection = {};
  selection.time = 7;
  expect_error(Flow({0, 1}), selection, "times of its own, 0 to 1");
}

}  // namespace
}  // namespace isoscope::source
