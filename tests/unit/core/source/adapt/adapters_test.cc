// Adapters of sources and series: none forgets to pass on what the inner one says.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "core/source/adapt/adjusted_source.h"
#include "core/source/adapt/magnitude_source.h"
#include "core/source/adapt/pieces_source.h"
#include "core/source/adapt/placed_source.h"
#include "core/source/adapt/resampled_source.h"
#include "core/source/adapt/slice_source.h"
#include "core/source/adapt/wide_source.h"
#include "core/source/series_parts.h"
#include "core/source/series_selection.h"
#include "tests/support/memory_source.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/core/partition/series_fixture.h"

namespace isoscope::source {
namespace {

using volume::ScalarType;

// No member has its default. A new one does not compile here until it gets a value.
SourceInfo FullInfo(ScalarType type) {
  SourceInfo info;
  auto& [name, geometry, scalar, frame, note, is_resampled, is_seekable, memory_bytes, planes] =
      info;
  name = "full";
  geometry.sample_dims = {4, 3, 2};
  geometry.spacing = {1, 2, 3};
  geometry.origin = {4, 5, 6};
  scalar = type;
  frame.emplace();
  note = "a note";
  is_resampled = true;
  is_seekable = false;
  memory_bytes = 1000;
  planes = 2;
  return info;
}

std::unique_ptr<VolumeSource> Full(ScalarType type = ScalarType::kInt16) {
  const SourceInfo info = FullInfo(type);
  return testing::MakeMemorySource(
      info, std::string(static_cast<std::size_t>(info.row_bytes()) * 6, '\0'));
}

TEST(AdaptersTest, AdjustedSourcePassesOnAllButGridPlanesAndMemory) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto source,
      AdjustSource(Full(), {.crop = SampleBox{.begin = {1, 0, 0}, .end = {4, 3, 2}}, .fill = 7}));
  SourceInfo expected = FullInfo(ScalarType::kInt16);
  expected.geometry.sample_dims = {3, 3, 2};
  expected.geometry.origin = {5, 5, 6};
  expected.memory_bytes += 3 * 4 * 2;  // a plane
  expected.planes_at_once = 1;
  EXPECT_TRUE(source->info() == expected);
}

TEST(AdaptersTest, FilledSourceChangesItsTypeToo) {
  SourceInfo info = FullInfo(ScalarType::kInt16);
  info.is_resampled = false;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto source,
      AdjustSource(testing::MakeMemorySource(info, std::string(48, '\0')), {.fill = 7}));
  info.type = ScalarType::kFloat32;
  info.memory_bytes += 3 * 4 * 2;
  info.planes_at_once = 1;
  EXPECT_TRUE(source->info() == info);
}

TEST(AdaptersTest, PlacedSourcePassesOnAllButGridAndNote) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source,
                                PlaceSource(Full(), {.origin = math::Vec3d{7, 8, 9}}));
  SourceInfo expected = FullInfo(ScalarType::kInt16);
  expected.geometry.origin = {7, 8, 9};
  expected.note = "a note; the grid is not that of the file: origin 7, 8, 9 in place of 4, 5, 6";
  EXPECT_TRUE(source->info() == expected) << source->info().note;

  expected.note = "a note";
  EXPECT_TRUE(MoveSource(Full(), expected.geometry)->info() == expected);
}

TEST(AdaptersTest, ResampledSourcePassesOnAllButGridTypeNoteAndMemory) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source,
                                ResampleSource(Full(), {{{}, {0, 1, 3}, {}}}, std::nullopt));
  SourceInfo expected = FullInfo(ScalarType::kInt16);
  expected.geometry.sample_dims.y = 4;
  expected.geometry.spacing.y = 1;
  expected.type = ScalarType::kFloat32;
  expected.note = "a note; axis y was resampled: 3 samples, 1 to 2 apart, became 4, 1 apart";
  expected.memory_bytes += 2 * 4 * 3 * 2;  // two planes
  expected.planes_at_once = 1;
  EXPECT_TRUE(source->info() == expected) << source->info().note;
}

TEST(AdaptersTest, WideSourcePassesOnAllButTheType) {
  SourceInfo expected = FullInfo(ScalarType::kFloat32);
  EXPECT_TRUE(MakeWideSource(Full(ScalarType::kUint16), WideType::kFloat16)->info() == expected);
}

TEST(AdaptersTest, MagnitudePassesOnAllOfTheFirstButTypeAndMemory) {
  std::vector<std::unique_ptr<VolumeSource>> components;
  components.push_back(Full());
  components.push_back(Full());
  SourceInfo expected = FullInfo(ScalarType::kFloat32);
  expected.memory_bytes = 2000 + 24 * 2 * 8;  // all samples, as two doubles each
  expected.planes_at_once = 1;
  EXPECT_TRUE(MakeMagnitudeSource(std::move(components))->info() == expected);
}

TEST(AdaptersTest, PiecesPassOnAllButTheMemory) {
  SourceInfo expected = FullInfo(ScalarType::kInt16);
  const auto source = MakePiecesSource(
      expected, {{.begin = {0, 0, 0}, .end = {4, 3, 2}, .first = {0, 0, 0}}}, 500,
      [](std::size_t) -> absl::StatusOr<std::unique_ptr<VolumeSource>> { return Full(); });
  expected.memory_bytes = source->info().memory_bytes;
  EXPECT_GT(expected.memory_bytes, 500);
  EXPECT_TRUE(source->info() == expected);
}

TEST(AdaptersTest, SlicesPassOnAllButSeekingAndMemory) {
  class NoSlices final : public SliceReader {
   public:
    absl::Status ReadSlice(std::int64_t /*z*/, char* /*out*/) override { return absl::OkStatus(); }
  };
  SourceInfo expected = FullInfo(ScalarType::kInt16);
  expected.is_seekable = true;
  const auto source = MakeSliceSource(expected, std::make_unique<NoSlices>());
  expected.is_seekable = false;
  expected.memory_bytes = 2 * 4 * 3 * 2;
  EXPECT_TRUE(source->info() == expected);
}

// No member has its default. A new one does not compile here until it gets a value.
std::unique_ptr<VolumeSeries> FullSeries() {
  SeriesInfo info;
  auto& [name, fields, elsewhere, times, time_unit, length_unit] = info;
  name = "full.nc";
  fields = partition::FlowFields();
  elsewhere = {"q"};
  times = {1, 2, 4};
  time_unit = "s";
  length_unit = "m";
  return std::make_unique<partition::MemorySeries>(std::move(info));
}

TEST(AdaptersTest, SeriesThatChangeTheirVolumesPassOnAll) {
  const SeriesInfo expected = FullSeries()->info();
  EXPECT_TRUE(AdjustSeries(FullSeries(), {.stride = 2})->info() == expected);
  EXPECT_TRUE(PlaceSeries(FullSeries(), {.origin = math::Vec3d{1, 2, 3}})->info() == expected);
}

TEST(AdaptersTest, SelectionPassesOnAllButFieldsAndTimes) {
  SeriesInfo expected = FullSeries()->info();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto series,
      SelectFrom(FullSeries(), {.fields = {"u"}, .steps = StepRange{.first = 1, .last = 2}}));
  expected.fields.erase(expected.fields.begin());
  expected.times = {2, 4};
  EXPECT_TRUE(series->info() == expected);
}

// The path of another grid's field begins with the file, not with its part.
TEST(AdaptersTest, PartPassesOnAllButTheFields) {
  SeriesInfo expected = FullSeries()->info();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, SelectPart(FullSeries(), "full.nc", "u:y"));
  expected.fields = {expected.fields[1]};
  expected.fields[0].components = {""};
  expected.fields_elsewhere.clear();
  EXPECT_TRUE(series->info() == expected);
}

}  // namespace
}  // namespace isoscope::source
