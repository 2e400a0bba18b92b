// Plans, without a disk. What is written by them: series_partitioner_test.

#include "core/partition/series_plan.h"

#include <array>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/unit/core/partition/series_fixture.h"

namespace isoscope::partition {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

// Field, component and step of each key.
std::vector<std::array<int, 3>> KeysOf(const std::vector<VolumeTask>& tasks) {
  std::vector<std::array<int, 3>> keys;
  for (const VolumeTask& task : tasks) {
    keys.push_back({task.key.field, task.key.component, task.key.step});
  }
  return keys;
}

store::SeriesManifest SeriesOf(MemorySeries& source) {
  PartitionOptions options;
  options.shard_count = 2;
  return PlanSeries(source, options, "flow").value();
}

// As if all that was planned had been written.
store::SeriesManifest WrittenSeriesOf(MemorySeries& source) {
  store::SeriesManifest series = SeriesOf(source);
  const std::vector<VolumeTask> tasks = PlanVolumes(source, series).value();
  for (const VolumeTask& task : tasks) {
    series.volumes.emplace_back().key = task.key;
  }
  return series;
}

TEST(SeriesPlanTest, FieldsHaveTheirComponentsAndSeveralAMagnitude) {
  MemorySeries source(FlowFields(), {0, 0.5});
  source.type_of = [](int field, int, int) {
    return field == 0 ? volume::ScalarType::kUint8 : volume::ScalarType::kFloat32;
  };
  const store::SeriesManifest series = SeriesOf(source);
  EXPECT_EQ(series.name, "flow");
  EXPECT_EQ(series.source, "flow.pvd");
  EXPECT_EQ(series.shard_count, 2);
  EXPECT_THAT(series.times, ElementsAre(0, 0.5));
  EXPECT_EQ(series.time_unit, "s");
  EXPECT_EQ(series.length_unit, "m");
  ASSERT_EQ(series.fields.size(), 2U);
  EXPECT_THAT(series.fields[0].components,
              ElementsAre(store::FieldComponent{"", volume::ScalarType::kUint8}));
  ASSERT_EQ(series.fields[1].components.size(), 4U);
  EXPECT_EQ(series.fields[1].components[1].name, "y");
  EXPECT_EQ(series.fields[1].components[3].name, "magnitude");
  EXPECT_THAT(series.volumes, IsEmpty());
}

TEST(SeriesPlanTest, VolumesComeByStepFieldAndComponent) {
  MemorySeries source(FlowFields(), {0, 0.5});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<VolumeTask> tasks,
                                PlanVolumes(source, SeriesOf(source)));
  using Key = std::array<int, 3>;
  EXPECT_THAT(KeysOf(tasks),
              ElementsAre(Key{0, 0, 0}, Key{1, 0, 0}, Key{1, 1, 0}, Key{1, 2, 0}, Key{1, 3, 0},
                          Key{0, 0, 1}, Key{1, 0, 1}, Key{1, 1, 1}, Key{1, 2, 1}, Key{1, 3, 1}));
}

TEST(SeriesPlanTest, AppendingNumbersFieldsAndStepsAsTheSeriesDoes) {
  MemorySeries first(FlowFields(), {0, 0.5});
  store::SeriesManifest series = WrittenSeriesOf(first);
  // The second field alone.
  MemorySeries later({FlowFields()[1]}, {0.75, 1});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<VolumeTask> tasks,
                                PlanAppending(later, /*resumes=*/false, &series));
  EXPECT_THAT(series.times, ElementsAre(0, 0.5, 0.75, 1));
  ASSERT_EQ(tasks.size(), 8U);
  EXPECT_EQ(tasks[5].key, (store::ScalarVolumeKey{.field = 1, .component = 1, .step = 3}));
  EXPECT_EQ(tasks[5].field, 0) << "in the source";
  EXPECT_EQ(tasks[5].step, 1) << "in the source";
}

TEST(SeriesPlanTest, WhatTheSeriesHasIsLeftOutOnlyByOneThatResumes) {
  MemorySeries source({FlowFields()[0]}, {0, 0.5});
  store::SeriesManifest series = WrittenSeriesOf(source);
  MemorySeries overlapping({FlowFields()[0]}, {0.5, 1});
  store::SeriesManifest unchanged = series;
  EXPECT_THAT(PlanAppending(overlapping, /*resumes=*/false, &unchanged).status(),
              StatusIs(absl::StatusCode::kAlreadyExists, HasSubstr("at time 0.5 already")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<VolumeTask> tasks,
                                PlanAppending(overlapping, /*resumes=*/true, &series));
  using Key = std::array<int, 3>;
  EXPECT_THAT(KeysOf(tasks), ElementsAre(Key{0, 0, 2}));
}

TEST(SeriesPlanTest, GridsThatDifferAreFoundAtTheirStep) {
  MemorySeries source(FlowFields(), {0, 0.5});
  const store::SeriesManifest series = SeriesOf(source);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<VolumeTask> tasks, PlanVolumes(source, series));
  const base::Cancellation never;
  source.open_count = 0;
  ISOSCOPE_EXPECT_OK(CheckGrids(source, tasks, series, never));
  EXPECT_EQ(source.open_count, 4) << "each field at each step";
  source.geometry_of = [&](int field, int, int step) {
    volume::GridGeometry grid = source.geometry;
    grid.spacing.x *= field == 1 && step == 1 ? 2 : 1;
    return grid;
  };
  EXPECT_THAT(CheckGrids(source, tasks, series, never),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("step 1")));
}

}  // namespace
}  // namespace isoscope::partition
