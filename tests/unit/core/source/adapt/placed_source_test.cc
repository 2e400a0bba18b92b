#include "core/source/adapt/placed_source.h"

#include <limits>
#include <memory>
#include <string>
#include <utility>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/source/adapt/resampled_source.h"
#include "core/source/single_series.h"
#include "tests/support/memory_source.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::Noise;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr math::Index3 kDims{4, 3, 2};
// A quarter turn about z: rows 0 -1 0, 1 0 0, 0 0 1.
constexpr math::Mat3d kTurned{{math::Vec3d{0, 1, 0}, math::Vec3d{-1, 0, 0}, math::Vec3d{0, 0, 1}}};

std::unique_ptr<VolumeSource> File(const volume::GridGeometry& geometry = {.sample_dims = kDims,
                                                                           .spacing = {1, 2, 3},
                                                                           .origin = {10, 20, 30},
                                                                           .direction = {}}) {
  return testing::MakeMemorySource(geometry, volume::ScalarType::kUint8,
                                   Noise(kDims, volume::ScalarType::kUint8), "scan.tif");
}

TEST(PlacedSourceTest, EachOfTheThreeTakesThePlaceOfTheFilesAlone) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto spaced,
                                PlaceSource(File(), {.spacing = math::Vec3d{1, 1, 4}}));
  EXPECT_EQ(spaced->info().geometry.spacing, (math::Vec3d{1, 1, 4}));
  EXPECT_EQ(spaced->info().geometry.origin, (math::Vec3d{10, 20, 30}));
  EXPECT_EQ(spaced->info().geometry.direction, math::Mat3d());
  EXPECT_EQ(spaced->info().note,
            "the grid is not that of the file: spacing 1, 1, 4 in place of 1, 2, 3");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto moved,
                                PlaceSource(File(), {.origin = math::Vec3d{-1, 0, 0.5}}));
  EXPECT_EQ(moved->info().geometry.origin, (math::Vec3d{-1, 0, 0.5}));
  EXPECT_EQ(moved->info().geometry.spacing, (math::Vec3d{1, 2, 3}));
  EXPECT_THAT(moved->info().note, HasSubstr("origin -1, 0, 0.5 in place of 10, 20, 30"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto turned, PlaceSource(File(), {.direction = kTurned}));
  EXPECT_EQ(turned->info().geometry.direction, kTurned);
  EXPECT_EQ(math::TransformPoint(turned->info().geometry.world_from_index(), {1, 0, 0}),
            (math::Vec3d{10, 21, 30}))
      << "the first column is the direction of x";
  EXPECT_THAT(turned->info().note, HasSubstr("direction 0, -1, 0; 1, 0, 0; 0, 0, 1 in place of"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string samples, ReadAll(*turned, 1));
  EXPECT_TRUE(samples == Noise(kDims, volume::ScalarType::kUint8));
}

TEST(PlacedSourceTest, WithoutAnOverrideTheSourceIsTheSame) {
  auto file = File();
  const VolumeSource* const before = file.get();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto after, PlaceSource(std::move(file), {}));
  EXPECT_EQ(after.get(), before);
  EXPECT_EQ(after->info().note, "");
}

TEST(PlacedSourceTest, NumbersThatMakeNoGridAreRefusedByName) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  for (const double bad : {0.0, -1.0, kNan, kInfinite}) {
    for (int axis = 0; axis < 3; ++axis) {
      math::Vec3d spacing{1, 1, 1};
      spacing[axis] = bad;
      EXPECT_THAT(PlaceSource(File(), {.spacing = spacing}),
                  StatusIs(kInvalid, HasSubstr("--spacing")));
    }
  }
  EXPECT_THAT(PlaceSource(File(), {.origin = math::Vec3d{0, kNan, 0}}),
              StatusIs(kInvalid, HasSubstr("--origin")));
  math::Mat3d longer = kTurned;
  longer.columns[1] = {-1.0004, 0, 0};
  EXPECT_THAT(Validate(GridOverride{.direction = longer}),
              StatusIs(kInvalid, AllOf(HasSubstr("axis y"), HasSubstr("1.0004"))));
  math::Mat3d nearly = kTurned;
  nearly.columns[1] = {-1.0002, 0, 0};
  ISOSCOPE_EXPECT_OK(Validate(GridOverride{.direction = nearly}));
  math::Mat3d sheared = kTurned;
  sheared.columns[2] = {0, 0.0004, 1};
  EXPECT_THAT(Validate(GridOverride{.direction = sheared}),
              StatusIs(kInvalid, AllOf(HasSubstr("axes x and z"), HasSubstr("degrees"))));
  sheared.columns[2] = {0, 0.0002, 1};
  ISOSCOPE_EXPECT_OK(Validate(GridOverride{.direction = sheared}));
  math::Mat3d unknown;
  unknown.columns[0].x = kNan;
  EXPECT_THAT(Validate(GridOverride{.direction = unknown}), StatusIs(kInvalid));
  EXPECT_THAT(PlaceSource(File(), {.spacing = math::Vec3d{1e30, 1, 1}}),
              StatusIs(kInvalid, HasSubstr("scan.tif: after --spacing")));
}

TEST(PlacedSourceTest, AShearedFileMayGetRightAngles) {
  volume::GridGeometry sheared{
      .sample_dims = kDims, .spacing = {1, 1, 1}, .origin = {}, .direction = {}};
  sheared.direction.columns[1] = {0.5, 0.8, 0};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto placed,
                                PlaceSource(File(sheared), {.direction = kTurned}));
  EXPECT_EQ(placed->info().geometry.direction, kTurned);
}

TEST(PlacedSourceTest, DistancesOfAResampledSourceAreTheFiles) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      auto resampled, ResampleSource(File(), AxisDistances{{{}, {0, 1, 3}, {}}}, std::nullopt));
  EXPECT_THAT(PlaceSource(std::move(resampled), {.spacing = math::Vec3d{1, 1, 1}}),
              StatusIs(kInvalid, HasSubstr("leave --spacing out, or --resample")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      resampled, ResampleSource(File(), AxisDistances{{{}, {0, 1, 3}, {}}}, std::nullopt));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto placed, PlaceSource(std::move(resampled), {.origin = math::Vec3d{1, 2, 3}}));
  EXPECT_TRUE(placed->info().is_resampled);
  EXPECT_THAT(placed->info().note,
              AllOf(HasSubstr("axis y was resampled"), HasSubstr("; the grid is")));
}

TEST(PlacedSourceTest, EachVolumeOfASeriesIsPlaced) {
  const auto series = PlaceSeries(MakeSingleSeries({.path = "scan.tif",
                                                    .field = "scan",
                                                    .length_unit = "mm",
                                                    .volume = File(),
                                                    .open = [] { return File(); }}),
                                  {.spacing = math::Vec3d{7, 8, 9}});
  for (int i = 0; i < 2; ++i) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, 0));
    EXPECT_EQ(volume->info().geometry.spacing, (math::Vec3d{7, 8, 9}));
  }
  EXPECT_EQ(series->info().name, "scan.tif");
  EXPECT_EQ(series->info().fields[0].name, "scan");
  EXPECT_EQ(series->info().length_unit, "mm");
}

}  // namespace
}  // namespace isoscope::source
