#include "clients/cpp/request/sweep_flags.h"

#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/cli/usage.h"
#include "tests/support/status_matchers.h"

namespace isoscope::client {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::vector<double> ValuesOf(absl::string_view text) {
  const absl::StatusOr<IsovalueRange> range = ParseIsovalues(text);
  EXPECT_THAT(range, testing::IsOk()) << text;
  std::vector<double> values;
  for (int i = 0; range.ok() && i < range->count; ++i) {
    values.push_back(range->At(i));
  }
  return values;
}

TEST(SweepTest, StopIsIncludedExactlyWhereTheStepDividesTheWay) {
  EXPECT_THAT(ValuesOf("20:40:5"), ElementsAre(20, 25, 30, 35, 40));
  EXPECT_THAT(ValuesOf("20:44:5"), ElementsAre(20, 25, 30, 35, 40));
  EXPECT_THAT(ValuesOf("40:20:-10"), ElementsAre(40, 30, 20));
  EXPECT_THAT(ValuesOf("-1:1:1"), ElementsAre(-1, 0, 1));
  EXPECT_THAT(ValuesOf("7:7:1"), ElementsAre(7));
  EXPECT_THAT(ValuesOf("7"), ElementsAre(7));
  EXPECT_THAT(ValuesOf("1e-3:3e-3:1e-3"), ElementsAre(1e-3, 2e-3, 3e-3));
}

TEST(SweepTest, DecimalStepsGiveTheNumbersThatAreTypedForOnePicture) {
  // 3 * 0.1 is not 0.3, and (1 - 0) / 0.1 is not above 10 in binary.
  EXPECT_THAT(ValuesOf("0:1:0.1"),
              ElementsAre(0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0));
  EXPECT_EQ(ValuesOf("0:0.7:0.1").size(), 8U);
}

TEST(SweepTest, WrongSweepsSayWhy) {
  for (const char* text : {"", "1:2", "1:2:3:4", "a:2:1", "1:b:1", "1:2:c", "1:2:0", "2:1:1",
                           "1:2:-1", "1:inf:1", "nan:1:1", "0:1e9:1", "0:1e300:1e-300", "1::1"}) {
    const absl::Status status = ParseIsovalues(text).status();
    EXPECT_THAT(status, StatusIs(absl::StatusCode::kInvalidArgument)) << text;
    EXPECT_THAT(std::string(status.message()), HasSubstr("'")) << text;
  }
}

// Parses a command line of sweep and request flags.
struct Parsed {
  SweepFlags sweep;
  RequestFlags request;
};
absl::Status Parse(const std::vector<std::string>& arguments, Parsed* parsed) {
  cli::FlagSet set;
  AddRequestFlags(&set, &parsed->request);
  AddSweepFlags(&set, &parsed->sweep, &parsed->request);
  return set.Parse(arguments);
}

// A request whose camera looks along z from 10 before the origin.
isoscope::v1::RenderIsosurfaceRequest FirstRequest() {
  isoscope::v1::RenderIsosurfaceRequest request;
  request.set_isovalue(10);
  isoscope::v1::Camera& camera = *request.mutable_camera();
  camera.mutable_eye()->set_z(10);
  camera.mutable_target();
  camera.mutable_up()->set_y(1);
  camera.mutable_perspective()->set_fov_y_degrees(30);
  return request;
}

TEST(SweepTest, SweepSetsTheIsovalueOfEachFrameAndOrbitTurnsBetween) {
  Parsed parsed;
  ISOSCOPE_ASSERT_OK(Parse({"--isovalue", "10:30:10", "--orbit", "90"}, &parsed));
  EXPECT_EQ(parsed.request.isovalue, 10) << "the checks of a request see the first value";
  ISOSCOPE_EXPECT_OK(CheckUsage(parsed.sweep, parsed.request.selection));
  EXPECT_EQ(parsed.sweep.frame_count(), 3);
  isoscope::v1::RenderIsosurfaceRequest frame = FirstRequest();
  ISOSCOPE_ASSERT_OK(SetFrame(parsed.sweep, 0, &frame));
  EXPECT_EQ(frame.SerializeAsString(), FirstRequest().SerializeAsString());
  ISOSCOPE_ASSERT_OK(SetFrame(parsed.sweep, 2, &frame));
  EXPECT_EQ(frame.isovalue(), 30);
  EXPECT_NEAR(frame.camera().eye().z(), -10, 1e-9);
  frame.mutable_camera()->mutable_eye()->CopyFrom(FirstRequest().camera().eye());
  frame.set_isovalue(10);
  EXPECT_EQ(frame.SerializeAsString(), FirstRequest().SerializeAsString()) << "nothing else";
}

// A colour, or labels beside it, have made the isovalue a surface.
TEST(SweepTest, TheFirstSurfaceIsTheOneOfTheSweep) {
  Parsed parsed;
  ISOSCOPE_ASSERT_OK(Parse({"--isovalue", "10:30:10"}, &parsed));
  isoscope::v1::RenderIsosurfaceRequest request = FirstRequest();
  PromoteIsovalue(&request);
  request.add_surfaces()->add_labels(7);
  ISOSCOPE_ASSERT_OK(SetFrame(parsed.sweep, 1, &request));
  EXPECT_EQ(request.surfaces(0).isovalue(), 20);
  EXPECT_EQ(request.surfaces(1).isovalue(), 0);
  EXPECT_EQ(request.isovalue(), 0);
}

TEST(SweepTest, EachFrameOfASweepOfStepsHasItsStep) {
  Parsed parsed;
  ISOSCOPE_ASSERT_OK(Parse({"--isovalue", "1", "--step", "0:6:2"}, &parsed));
  isoscope::v1::Dataset dataset;
  for (const int number : {0, 1, 2, 5, 6}) {
    dataset.add_time_steps()->set_number(number);
  }
  ISOSCOPE_ASSERT_OK(ResolveSteps(dataset, &parsed.sweep));
  EXPECT_EQ(parsed.sweep.frame_count(), 3);
  isoscope::v1::RenderIsosurfaceRequest request = FirstRequest();
  ISOSCOPE_ASSERT_OK(SetFrame(parsed.sweep, 2, &request));
  EXPECT_EQ(request.selection().time_step(), 6);
}

TEST(SweepTest, NegativeStartIsNoFlag) {
  Parsed parsed;
  ISOSCOPE_ASSERT_OK(Parse({"--isovalue", "-10:10:5"}, &parsed));
  EXPECT_EQ(parsed.sweep.frame_count(), 5);
  EXPECT_EQ(parsed.request.isovalue, -10);
}

TEST(SweepTest, OneIsovalueIsNoSweep) {
  Parsed parsed;
  ISOSCOPE_ASSERT_OK(Parse({"--isovalue", "-1.5", "--repeat", "4"}, &parsed));
  EXPECT_EQ(parsed.request.isovalue, -1.5);
  EXPECT_FALSE(parsed.sweep.is_isovalue_sweep());
  EXPECT_EQ(parsed.sweep.frame_count(), 4);
  ISOSCOPE_EXPECT_OK(CheckUsage(parsed.sweep, parsed.request.selection));
}

TEST(SweepTest, FlagsThatDoNotFitEachOtherAreWrongUsage) {
  struct Case {
    std::vector<std::string> arguments;
    std::string message;
  };
  for (const Case& c : std::vector<Case>{
           {{"--isovalue", "1:3:1", "--repeat", "3"}, "which has 3 frames"},
           {{"--isovalue", "1", "--orbit", "10"}, "--repeat N"},
           {{"--isovalue", "1", "--step", "0:3", "--repeat", "3"}, "leave --repeat out"},
           {{"--isovalue", "1:3:1", "--step", "0:3"}, "leave the sweep of isovalues out"},
           {{"--isovalue", "1", "--time", "2.5", "--step", "0:3"}, "--time and --step exclude"},
           {{"--isovalue", "1", "--step", "0:last:2", "--time", "0"}, "--step A:B names"}}) {
    Parsed parsed;
    ISOSCOPE_ASSERT_OK(Parse(c.arguments, &parsed));
    const absl::Status status = CheckUsage(parsed.sweep, parsed.request.selection);
    EXPECT_TRUE(cli::IsUsageError(status)) << c.message;
    EXPECT_THAT(std::string(status.message()), HasSubstr(c.message));
  }
  for (const char* fps : {"0", "-1", "121", "nan", "x"}) {
    Parsed parsed;
    EXPECT_THAT(Parse({"--fps", fps}, &parsed),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("0.1 to 120")))
        << fps;
  }
}

isoscope::v1::Dataset WithSteps(const std::vector<int>& numbers) {
  isoscope::v1::Dataset dataset;
  dataset.set_name("flow");
  for (const int number : numbers) {
    dataset.add_time_steps()->set_number(number);
  }
  return dataset;
}

TEST(StepSweepTest, StepsAreThoseThatAreServed) {
  const isoscope::v1::Dataset dataset = WithSteps({0, 1, 2, 5, 6});
  const std::vector<std::pair<const char*, std::vector<int>>> rows = {
      {"0:2", {0, 1, 2}},
      {"1:6", {1, 2, 5, 6}},
      {"first:last", {0, 1, 2, 5, 6}},
      {"first:last:2", {0, 2, 6}},
      {"6:0:-1", {6, 5, 2, 1, 0}},
      {"last:first:-3", {6, 0}},
      {"2:2", {2}},
      {"5:1000000:1", {5, 6}},
      {"7", {7}},
      {"last", {6}}};
  for (const auto& [text, expected] : rows) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const StepRange range, ParseSteps(text));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<int> steps, StepsOf(range, dataset));
    EXPECT_EQ(steps, expected) << text;
  }
}

TEST(StepSweepTest, RangesWithoutAServedStepSayWhichThereAre) {
  for (const char* text : {"3:4", "6:0", "0:6:-1", "7:9"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const StepRange range, ParseSteps(text));
    EXPECT_THAT(StepsOf(range, WithSteps({0, 1, 2, 5, 6})),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("0 to 6")))
        << text;
    EXPECT_THAT(StepsOf(range, WithSteps({})),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("has 0 to 0")));
  }
  for (const char* text : {"first:last", "0:0", "last", "0:3"}) {
    EXPECT_EQ(StepsOf(ParseSteps(text).value(), WithSteps({})).value(), std::vector<int>{0})
        << "a dataset without fields has step 0";
  }
}

TEST(StepSweepTest, WrongStepsAreQuoted) {
  for (const char* text : {"", "x", "-1", "1:", ":1", "0:1:0", "0:1:x", "0:1:1:1", "1.5"}) {
    EXPECT_THAT(ParseSteps(text), StatusIs(absl::StatusCode::kInvalidArgument)) << text;
  }
}

// Symptom: a stranger's range kept a thread for minutes.
TEST(StepSweepTest, ARangeCostsAsMuchAsTheStepsThatAreServed) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const StepRange range, ParseSteps("0:2147483646"));
  for (int i = 0; i < 1000; ++i) {
    EXPECT_EQ(StepsOf(range, {0, 7}, "it").value(), (std::vector<int>{0, 7}));
  }
}

}  // namespace
}  // namespace isoscope::client
