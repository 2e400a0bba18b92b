#include "core/formats/dicom/dicom_steps.h"

#include <optional>
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
using ::testing::IsEmpty;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

DicomSlice SliceAt(double z, const DicomMoment& moment, const std::string& path = "f") {
  DicomSlice slice;
  slice.path = path;
  slice.origin = {1, 2, z};
  slice.spacing = {0.5, 0.5, 1};
  slice.position = z;
  slice.moment = moment;
  return slice;
}

// Two steps at three places, in no order; `moment` tells them apart.
template <typename MakeMoment>
absl::StatusOr<DicomSteps> SplitTwo(const MakeMoment& moment) {
  std::vector<DicomSlice> slices;
  for (const int z : {2, 0, 1}) {
    for (const int step : {1, 0}) {
      slices.push_back(SliceAt(z, moment(step, z), absl::StrCat(step, "-", z)));
    }
  }
  return SplitDicomSteps(std::move(slices), "d");
}

TEST(DicomStepsTest, KeysInTheirOrder) {
  struct Case {
    const char* name;
    DicomMoment (*moment)(int step, int z);
    std::vector<double> times;
    const char* unit;
  } const cases[] = {
      {"position",
       [](int s, int) { return DicomMoment{.temporal_position = 7.0 + s}; },
       {0, 1},
       ""},
      {"resolution",
       [](int s, int) {
         return DicomMoment{.temporal_position = 1.0 + s, .temporal_resolution = 2.5};
       },
       {0, 2.5},
       "ms"},
      {"echo",
       [](int s, int) { return DicomMoment{.temporal_position = 1.0, .echo_time = 5.0 + s}; },
       {5, 6},
       "ms"},
      {"trigger",
       [](int s, int z) {
         return DicomMoment{.echo_time = 3.0, .trigger_time = 20.0 * s + 0.1 * z};
       },
       {0, 20},
       "ms"},
      {"dimensions",
       [](int s, int z) {
         return DicomMoment{.trigger_time = 5.0,
                            .dimension_rank = 7.0 - 2 * z + 3 * s,
                            .acquisition_number = 1.0 - s};
       },
       {0, 1},
       ""},
      {"acquisition",
       [](int s, int z) { return DicomMoment{.acquisition_time = 36000.0 + 2 * s + 0.1 * z}; },
       {0, 2},
       "s"},
      {"instance",
       [](int s, int z) { return DicomMoment{.instance_number = 3.0 * s + z}; },
       {0, 1},
       ""}};
  for (const Case& c : cases) {
    SCOPED_TRACE(c.name);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DicomSteps result, SplitTwo(c.moment));
    ASSERT_EQ(result.steps.size(), 2U);
    for (int step = 0; step < 2; ++step) {
      const auto& slices = result.steps[static_cast<std::size_t>(step)];
      ASSERT_EQ(slices.size(), 3U);
      for (int z = 0; z < 3; ++z) {
        EXPECT_EQ(slices[static_cast<std::size_t>(z)].path, absl::StrCat(step, "-", z));
      }
    }
    EXPECT_EQ(result.times, c.times);
    EXPECT_EQ(result.time_unit, c.unit);
  }
}

TEST(DicomStepsTest, OneImageAPlaceIsOneStep) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const DicomSteps result,
      SplitDicomSteps({SliceAt(1, {}, "b"), SliceAt(0, {}, "a"), SliceAt(5, {}, "c")}, "d"));
  ASSERT_EQ(result.steps.size(), 1U);
  EXPECT_EQ(result.steps[0][0].path, "a");
  EXPECT_EQ(result.steps[0][2].path, "c");
  EXPECT_THAT(result.times, IsEmpty());
  // One there twice is left to the check of distances.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const DicomSteps twice,
      SplitDicomSteps({SliceAt(0, {}), SliceAt(0, {}), SliceAt(1, {}), SliceAt(2, {})}, "d"));
  EXPECT_EQ(twice.steps[0].size(), 4U);
}

TEST(DicomStepsTest, WhatMakesNoStepsIsNamed) {
  EXPECT_THAT(SplitTwo([](int, int) { return DicomMoment{.instance_number = 1.0}; }),
              StatusIs(kInvalid, AllOf(HasSubstr("2 images at each of 3 places"),
                                       HasSubstr("nothing tells apart"))));
  std::vector<DicomSlice> slices;
  for (const int z : {0, 1, 2}) {
    for (const int step : {0, 1, 2}) {
      if (z != 1 || step != 1) {
        slices.push_back(SliceAt(z, {.temporal_position = step}, absl::StrCat(step, "-", z)));
      }
    }
  }
  EXPECT_THAT(
      SplitDicomSteps(std::move(slices), "d"),
      StatusIs(kInvalid, AllOf(HasSubstr("2 of 3 places have 3 images"), HasSubstr("0-1 has 2"))));
}

}  // namespace
}  // namespace isoscope::source
