#include "clients/cpp/request/selection_flags.h"

#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "clients/cpp/request/dataset_fields.h"
#include "clients/cpp/request/look_flags.h"
#include "core/cli/usage.h"
#include "tests/support/status_matchers.h"

namespace isoscope::client {
namespace {

using ::testing::HasSubstr;
using testing::StatusIs;

SelectionFlags Parse(const std::vector<std::string>& arguments) {
  cli::FlagSet set;
  SelectionFlags flags;
  AddSelectionFlags(&set, &flags);
  ISOSCOPE_EXPECT_OK(set.Parse(arguments));
  return flags;
}

TEST(SelectionFlagsTest, FieldsHaveANameAndMayHaveAComponent) {
  const std::vector<std::pair<const char*, FieldValue>> right = {
      // Who has the names of all fields splits it.
      {"pressure", {"pressure", ""}},
      {"velocity:x", {"velocity:x", ""}},
      {"a:b:2", {"a:b:2", ""}}};
  for (const auto& [text, expected] : right) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FieldValue value, ParseField(text));
    EXPECT_EQ(value, expected) << text;
  }
  for (const char* text : {"", ":", ":x", "velocity:"}) {
    EXPECT_THAT(ParseField(text), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("'")))
        << text;
  }
}

TEST(SelectionFlagsTest, StepsAreNumbersOrEnds) {
  const std::vector<std::pair<const char*, std::int64_t>> right = {
      {"0", 0}, {"17", 17}, {"first", 0}, {"last", -1}, {"2147483647", 2147483647}};
  for (const auto& [text, expected] : right) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::int64_t step, ParseStep(text));
    EXPECT_EQ(step, expected) << text;
  }
  for (const char* text : {"", "-1", "1.5", "2147483648", "second", "0:3"}) {
    EXPECT_THAT(ParseStep(text),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("first or last")))
        << text;
  }
}

TEST(SelectionFlagsTest, TheSelectionSaysWhatTheFlagsSay) {
  EXPECT_FALSE(ToProto(Parse({})).has_value());
  const struct {
    std::vector<std::string> arguments;
    std::string proto;
  } cases[] = {
      {{"--field", "pressure"}, "field: \"pressure\""},
      {{"--field", "velocity:y", "--step", "3"}, "field: \"velocity:y\" time_step: 3"},
      {{"--field", "velocity", "--component", "z"}, "field: \"velocity\" component: \"z\""},
      {{"--component", "z"}, "component: \"z\""},
      {{"--time", "-0.25"}, "time: -0.25"},
      {{"--step", "last"}, "time_step: -1"},
      {{"--step", "first"}, "time_step: 0"},
  };
  for (const auto& c : cases) {
    const SelectionFlags flags = Parse(c.arguments);
    ISOSCOPE_EXPECT_OK(CheckUsage(flags));
    EXPECT_EQ(ToProto(flags)->ShortDebugString(), c.proto);
  }
}

TEST(SelectionFlagsTest, WhatNamesOneThingTwiceIsAnError) {
  const absl::Status two_times = CheckUsage(Parse({"--time", "1", "--step", "2"}));
  EXPECT_TRUE(cli::IsUsageError(two_times));
  EXPECT_THAT(std::string(two_times.message()), HasSubstr("--time and --step"));
  isoscope::v1::Dataset dataset;
  dataset.add_fields()->set_name("velocity");
  SelectionFlags flags = Parse({"--field", "velocity:x", "--component", "y"});
  const absl::Status two_components = ResolveNames(dataset, &flags);
  EXPECT_TRUE(cli::IsUsageError(two_components));
  EXPECT_THAT(std::string(two_components.message()), HasSubstr("velocity:x"));
}

TEST(SelectionFlagsTest, ANearNameIsSuggestedForAFieldThatIsNotThere) {
  isoscope::v1::Dataset dataset;
  dataset.set_name("flow");
  dataset.add_fields()->set_name("pressure");
  for (const char* text : {"presure", "Pressure", "presure:x"}) {
    SelectionFlags flags = Parse({"--field", text});
    EXPECT_THAT(ResolveNames(dataset, &flags),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         ::testing::AllOf(HasSubstr(text), HasSubstr("did you mean 'pressure'?"))));
    LookFlags look;
    look.color_by.push_back(*ParseColorBy(text));
    flags = SelectionFlags();
    EXPECT_THAT(ResolveNames(dataset, &flags, &look),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("'pressure'")));
  }
}

// Symptom: a field whose name has a colon could not be chosen.
TEST(SelectionFlagsTest, NamesAreThoseOfTheDatasetTheLongestFirst) {
  isoscope::v1::Dataset dataset;
  for (const char* name : {"a", "a:b", "velocity"}) {
    dataset.add_fields()->set_name(name);
  }
  for (const auto& [text, expected] : std::vector<std::pair<const char*, FieldValue>>{
           {"a", {"a", ""}},
           {"a:b", {"a:b", ""}},
           {"a:b:x", {"a:b", "x"}},
           {"a:c", {"a", "c"}},
           {"velocity:x", {"velocity", "x"}},
           {"heat:x", {"heat:x", ""}}}) {  // for the server to refuse
    SelectionFlags flags = Parse({"--field", text});
    LookFlags look;
    look.color_by.push_back(*ParseColorBy(text));
    ISOSCOPE_EXPECT_OK(ResolveNames(dataset, &flags, &look));
    EXPECT_EQ(*flags.field, expected) << text;
    EXPECT_EQ(look.color_by[0].field, expected.name) << text;
    EXPECT_EQ(look.color_by[0].component, expected.component) << text;
  }
}

}  // namespace
}  // namespace isoscope::client
