#include "core/source/dicom_stack.h"

#include <string>
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
  const std::vector<math::Vec3d> origins = {{1, 2, 3}, {1, 6, 6}, {1, 14, 12}};
  EXPECT_THAT(Stack(origins),
              StatusIs(kInvalid, AllOf(HasSubstr("s2: 3 behind s1, where 4.5 is the mean"),
                                       HasSubstr("one is missing, or there twice"),
                                       HasSubstr("--resample"))));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto stack, Stack(origins, {.resamples = true}));
  EXPECT_THAT(stack.distances, ElementsAre(0, 5, 15));  // along the line, not the normal
  EXPECT_DOUBLE_EQ(stack.geometry.spacing.z, 7.5);
  // Even ones stay as they are.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto even,
                                Stack({{1, 2, 3}, {1, 2, 6}, {1, 2, 9}}, {.resamples = true}));
  EXPECT_THAT(even.distances, ElementsAre());
  EXPECT_THAT(Stack({{1, 2, 3}, {1, 2, 3}, {1, 2, 12}}, {.resamples = true}),
              StatusIs(kInvalid, HasSubstr("it is there twice")));
  EXPECT_THAT(Stack({{1, 2, 3}, {1, 2, 3}}, {.resamples = true}), StatusIs(kInvalid));
}

TEST(DicomStackTest, SlicesOfAnotherKindAreRefused) {
  std::vector<DicomSlice> slices = At({{1, 2, 3}, {1, 2, 6}});
  slices[1].direction.columns = {math::Vec3d{0, 1, 0}, math::Vec3d{1, 0, 0}, math::Vec3d{0, 0, -1}};
  EXPECT_THAT(StackSlices(&slices, "folder", {}),
              StatusIs(kInvalid, HasSubstr("expected parallel slices")));
  EXPECT_THAT(Stack({{1, 2, 3}}), StatusIs(kInvalid, HasSubstr("a series of one slice (s1)")));
}

}  // namespace
}  // namespace isoscope::source
