#include "core/formats/dicom/dicom_stack.h"

#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

// Slices of axial planes, each at a place of its own, in the order of their names.
std::vector<DicomSlice> At(const std::vector<math::Vec3d>& origins) {
  std::vector<DicomSlice> slices;
  for (const math::Vec3d& origin : origins) {
    DicomSlice& slice = slices.emplace_back();
    slice.path = absl::StrCat("s", slices.size());
    slice.width = 4;
    slice.height = 3;
    slice.spacing = {0.5, 0.5, 1};
    slice.origin = origin;
    slice.position = origin.z;
  }
  return slices;
}

absl::StatusOr<SliceStack> Stack(const std::vector<math::Vec3d>& origins,
                                 const GridRules& rules = {}) {
  std::vector<DicomSlice> slices = At(origins);
  return StackSlices(&slices, "folder", rules);
}

TEST(DicomStackTest, SlicesAreSortedAlongTheirNormal) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto stack, Stack({{1, 2, 9}, {1, 2, 3}, {1, 2, 6}}));
  EXPECT_EQ(stack.geometry.sample_dims, (math::Index3{4, 3, 3}));
  EXPECT_EQ(stack.geometry.spacing, (math::Vec3d{0.5, 0.5, 3}));
  EXPECT_EQ(stack.geometry.origin, (math::Vec3d{1, 2, 3}));
  EXPECT_EQ(stack.geometry.direction, math::Mat3d());
  EXPECT_THAT(stack.distances, ElementsAre());
}

// A gantry that leans 4 to 3, as every CT of a head that spares the eyes.
TEST(DicomStackTest, LeaningStackHasItsOwnThirdAxis) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto stack, Stack({{1, 2, 3}, {1, 6, 6}, {1, 10, 9}}));
  EXPECT_DOUBLE_EQ(stack.geometry.spacing.z, 5);
  EXPECT_LT(math::Length(stack.geometry.direction.columns[2] - math::Vec3d{0, 0.8, 0.6}), 1e-15);
  EXPECT_EQ(stack.geometry.direction.columns[1], (math::Vec3d{0, 1, 0}));
  // One that leaves the line.
  EXPECT_THAT(Stack({{1, 2, 3}, {1, 5.9, 6}, {1, 10, 9}}),
              StatusIs(kInvalid, AllOf(HasSubstr("s2: begins 0.1 beside the line"))));
  // A hundredth of the distance and of a pixel is nothing, and the normal stays the axis.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto nearly, Stack({{1, 2, 3}, {1, 2.03, 6}, {1, 2.01, 9}}));
  EXPECT_EQ(nearly.geometry.direction, math::Mat3d());
}

TEST(DicomStackTest, UnevenDistancesAreRefusedOrGivenToWhoResamples) {
  const std::vector<math::Vec3d> origins = {{1, 2, 3}, {1, 6, 6}, {1, 12, 10.5}};
  EXPECT_THAT(Stack(origins),
              StatusIs(kInvalid, AllOf(HasSubstr("s3: 4.5 behind s2, where 3 is the usual"),
                                       HasSubstr("expected slices at one distance"),
                                       HasSubstr("--resample"))));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto stack, Stack(origins, {.resamples = true}));
  EXPECT_THAT(stack.distances, ElementsAre(0, 5, 12.5));  // along the line, not the normal
  EXPECT_DOUBLE_EQ(stack.geometry.spacing.z, 6.25);
  // Even ones stay as they are.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto even,
                                Stack({{1, 2, 3}, {1, 2, 6}, {1, 2, 9}}, {.resamples = true}));
  EXPECT_THAT(even.distances, ElementsAre());
}

// Slices at these z.
absl::StatusOr<SliceStack> StackAt(const std::vector<double>& places, const GridRules& rules = {}) {
  std::vector<math::Vec3d> origins;
  for (const double place : places) {
    origins.push_back({1, 2, place});
  }
  return Stack(origins, rules);
}

TEST(DicomStackTest, DistancesMayDifferByOnePercentOfTheirMean) {
  ISOSCOPE_EXPECT_OK(StackAt({0, 1.009, 2}));
  EXPECT_THAT(StackAt({0, 1.011, 2}), StatusIs(kInvalid, HasSubstr("1.011 behind")));
  ISOSCOPE_EXPECT_OK(StackAt({0, 0.991, 2}));
  EXPECT_THAT(StackAt({0, 0.989, 2}), StatusIs(kInvalid));
}

TEST(DicomStackTest, SmallDifferencesMustNotAddUpToATenthOfADistance) {
  const auto drifting = [](int count, double off) {  // first nearer, then farther
    std::vector<double> places{0};
    for (int i = 0; i < count; ++i) {
      places.push_back(places.back() + (i < count / 2 ? 1 - off : 1 + off));
    }
    return places;
  };
  ISOSCOPE_EXPECT_OK(StackAt(drifting(22, 0.009)));  // 11 times 0.009
  EXPECT_THAT(StackAt(drifting(24, 0.009)), StatusIs(kInvalid, HasSubstr("add up")));
  ISOSCOPE_EXPECT_OK(StackAt(drifting(24, 0.009), {.resamples = true}));
}

TEST(DicomStackTest, SlicesThatAreMissingOrThereTwiceAreNamed) {
  EXPECT_THAT(StackAt({0, 1, 2, 4, 5}),
              StatusIs(kInvalid, AllOf(HasSubstr("s4: 2 behind s3, where 1 is the usual distance"),
                                       HasSubstr("1 slice is missing between them"))));
  EXPECT_THAT(StackAt({0, 1, 2, 5, 6}),
              StatusIs(kInvalid, AllOf(HasSubstr("2 slices are missing"),
                                       ::testing::Not(HasSubstr("two stacks")))));
  EXPECT_THAT(StackAt({0, 1, 2, 8, 9, 10}),
              StatusIs(kInvalid, AllOf(HasSubstr("two stacks, or 5 slices are missing"),
                                       HasSubstr("give a folder with the slices of one stack"),
                                       ::testing::Not(HasSubstr("--resample")))));
  EXPECT_THAT(StackAt({0, 1, 2, 4.5, 5.5}), StatusIs(kInvalid, HasSubstr("at one distance")));
  for (const bool resamples : {false, true}) {
    EXPECT_THAT(StackAt({0, 1, 1, 2}, {.resamples = resamples}),
                StatusIs(kInvalid,
                         AllOf(HasSubstr("s2 and s3 lie at one place"), HasSubstr("there twice"))));
    EXPECT_THAT(StackAt({3, 3}, {.resamples = resamples}), StatusIs(kInvalid, HasSubstr("twice")));
  }
  // A thousandth of the distance is a place of its own no more.
  EXPECT_THAT(StackAt({0, 0.0009, 2}, {.resamples = true}), StatusIs(kInvalid));
  ISOSCOPE_EXPECT_OK(StackAt({0, 0.0011, 2}, {.resamples = true}));
}

TEST(DicomStackTest, SlicesBesideTheLineAreMeasuredInDistancesAndPixels) {
  // A hundredth of 3, and of a pixel of 0.5.
  ISOSCOPE_EXPECT_OK(Stack({{1, 2, 0}, {1, 2.034, 3}, {1, 2, 6}}));
  EXPECT_THAT(Stack({{1, 2, 0}, {1, 2.036, 3}, {1, 2, 6}}),
              StatusIs(kInvalid, HasSubstr("beside")));
  EXPECT_THAT(Stack({{1, 2, 0}, {1.036, 2, 3}, {1, 2, 6}}),
              StatusIs(kInvalid, HasSubstr("beside")));
}

TEST(DicomStackTest, SlicesOfAnotherKindAreRefused) {
  std::vector<DicomSlice> slices = At({{1, 2, 3}, {1, 2, 6}, {1, 2, 9}});
  slices[1].direction.columns = {math::Vec3d{0, 1, 0}, math::Vec3d{1, 0, 0}, math::Vec3d{0, 0, -1}};
  EXPECT_THAT(StackSlices(&slices, "folder", {}),
              StatusIs(kInvalid, AllOf(HasSubstr("folder: slices of 2 orientations (2 as s1; 1 as"),
                                       HasSubstr("expected parallel slices"))));
  EXPECT_THAT(Stack({{1, 2, 3}}), StatusIs(kInvalid, HasSubstr("a series of one slice (s1)")));
  slices = At({{1, 2, 3}, {1, 2, 6}});
  slices[1].height = 4;
  EXPECT_THAT(StackSlices(&slices, "folder", {}),
              StatusIs(kInvalid, HasSubstr("s2: 4 x 4 samples, but s1 has 4 x 3")));
  slices = At({{1, 2, 3}, {1, 2, 6}});
  slices[1].width = 5;
  EXPECT_THAT(StackSlices(&slices, "folder", {}), StatusIs(kInvalid, HasSubstr("one size")));
}

// A distance that the user gives can't be right for two; slices that say none are those he means.
TEST(DicomStackTest, PixelsOfSeveralSpacingsAreRefusedAlsoIfTheUserGivesOne) {
  std::vector<DicomSlice> slices = At({{1, 2, 3}, {1, 2, 6}, {1, 2, 9}});
  slices[0].spacing = {1, 1, 1};
  slices[0].has_spacing = false;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SliceStack stack,
                                StackSlices(&slices, "folder", {.has_spacing = true}));
  EXPECT_EQ(stack.geometry.origin, (math::Vec3d{1, 2, 3}));
  EXPECT_EQ(stack.geometry.spacing, (math::Vec3d{0.5, 0.5, 3}));
  slices[2].spacing = {0.5, 0.6, 1};
  EXPECT_THAT(StackSlices(&slices, "folder", {.has_spacing = true}),
              StatusIs(kInvalid, HasSubstr("s3: pixels of 0.5 x 0.6, but s2 has 0.5 x 0.5")));
}

TEST(DicomStackTest, ValuesOfSeveralUnitsAndPlacesOfSeveralFramesAreRefused) {
  std::vector<DicomSlice> slices = At({{1, 2, 3}, {1, 2, 6}, {1, 2, 9}});
  for (DicomSlice& slice : slices) {
    slice.value_unit = "BQML";
    slice.frame_of_reference = "1.2.3";
  }
  ISOSCOPE_EXPECT_OK(StackSlices(&slices, "folder", {}).status());
  slices[2].value_unit = "CNTS";
  EXPECT_THAT(
      StackSlices(&slices, "folder", {}),
      StatusIs(kInvalid, HasSubstr("s3: values in CNTS, but s1 has values in BQML (units (0054")));
  slices[2].value_unit = "";
  EXPECT_THAT(StackSlices(&slices, "folder", {}), StatusIs(kInvalid, HasSubstr("s3: no unit")));
  slices[2].value_unit = "BQML";
  for (const auto& [uid, words] : {std::pair("1.2.4", "s3: another frame of reference (0020,0052)"),
                                   std::pair("", "s3: no frame of reference (0020,0052)")}) {
    slices[2].frame_of_reference = uid;
    EXPECT_THAT(StackSlices(&slices, "folder", {}),
                StatusIs(kInvalid, AllOf(HasSubstr(words), ::testing::Not(HasSubstr("1.2.")))));
  }
}

TEST(DicomStackTest, OrientationsAndPixelsMayDifferByAThousandth) {
  const auto with = [](double tilt_row, double tilt_column, double x, double y) {
    std::vector<DicomSlice> slices = At({{1, 2, 3}, {1, 2, 6}});
    slices[1].direction.columns[0].y = tilt_row;
    slices[1].direction.columns[1].x = tilt_column;
    slices[1].spacing = {0.5 * x, 0.5 * y, 1};
    return StackSlices(&slices, "folder", {}).status();
  };
  ISOSCOPE_EXPECT_OK(with(9e-4, 0, 1, 1));
  ISOSCOPE_EXPECT_OK(with(0, 9e-4, 1, 1));
  EXPECT_THAT(with(1.1e-3, 0, 1, 1), StatusIs(kInvalid, HasSubstr("parallel")));
  EXPECT_THAT(with(0, 1.1e-3, 1, 1), StatusIs(kInvalid, HasSubstr("parallel")));
  ISOSCOPE_EXPECT_OK(with(0, 0, 1.0009, 0.9991));
  EXPECT_THAT(with(0, 0, 1.0011, 1), StatusIs(kInvalid, HasSubstr("s2: pixels of 0.50055 x 0.5")));
  EXPECT_THAT(with(0, 0, 1, 0.9989), StatusIs(kInvalid, HasSubstr("one spacing")));
}

}  // namespace
}  // namespace isoscope::source
