#include "clients/cpp/request/label_flags.h"

#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "clients/cpp/request/render_request.h"
#include "core/cli/usage.h"
#include "core/view/camera.h"
#include "isoscope/v1/dataset_service.pb.h"
#include "tests/support/status_matchers.h"

namespace isoscope::client {
namespace {

namespace v1 = isoscope::v1;

using frame::Color;
using ::isoscope::testing::IsOk;
using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

v1::Dataset Organs() {
  v1::Dataset dataset;
  dataset.set_name("organs");
  dataset.set_sample_type(v1::SAMPLE_TYPE_UINT8);
  const auto add = [&](double value, const char* name) {
    v1::Label* const label = dataset.add_labels();
    label->set_value(value);
    label->set_name(name);
    return label;
  };
  add(0, "background");
  v1::Color* const red = add(3, "left lung")->mutable_color();
  red->set_red(1);
  red->set_alpha(1);
  add(4, "Right lung");
  add(5, "3-7");
  add(6, "a,b: c");
  add(7, "twin");
  add(8, "twin");
  return dataset;
}

LabelFlags FlagsOf(const std::vector<std::string>& texts) {
  LabelFlags flags;
  for (const std::string& text : texts) {
    const auto value = ParseLabel(text);
    EXPECT_THAT(value.status(), IsOk()) << text;
    flags.sets.push_back(value.value_or(LabelValue{}));
  }
  return flags;
}

std::vector<double> ValuesOf(const std::string& text) {
  LabelFlags flags = FlagsOf({text});
  const absl::Status status = ResolveLabels(Organs(), std::nullopt, &flags);
  EXPECT_THAT(status, IsOk()) << text;
  return status.ok() ? flags.surfaces[0].values : std::vector<double>();
}

absl::Status ErrorOf(const std::string& text) {
  LabelFlags flags = FlagsOf({text});
  return ResolveLabels(Organs(), std::nullopt, &flags);
}

TEST(LabelFlagsTest, ASetHasAColourAndAnOpacityOrEither) {
  EXPECT_EQ(*ParseLabel("3,7"), (LabelValue{.set = "3,7"}));
  EXPECT_EQ(*ParseLabel("3:teal"),
            (LabelValue{.set = "3", .color = Color{0, 128 / 255.0F, 128 / 255.0F, 1}}));
  EXPECT_EQ(*ParseLabel("3:1,0.5,0:0.25"),
            (LabelValue{.set = "3", .color = Color{1, 0.5F, 0, 1}, .opacity = 0.25F}));
  EXPECT_EQ(*ParseLabel("left lung::0.5"), (LabelValue{.set = "left lung", .opacity = 0.5F}));
  EXPECT_EQ(*ParseLabel("a,b: c"), (LabelValue{.set = "a,b: c"}));
  EXPECT_EQ(*ParseLabel("a,b: c:#ff0000"),
            (LabelValue{.set = "a,b: c", .color = Color{1, 0, 0, 1}}));
  for (const char* text :
       {"", ":red", "::0.5", "3:reddish", "3:", "3,7::0", "3:red:1.5", "3::-1"}) {
    EXPECT_THAT(ParseLabel(text).status(),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("SET:COLOR")))
        << text;
  }
}

TEST(LabelFlagsTest, ValuesRangesAndNamesMakeASet) {
  EXPECT_THAT(ValuesOf("7,3"), ElementsAre(3, 7));
  EXPECT_THAT(ValuesOf("3, 3 ,3.0"), ElementsAre(3));
  EXPECT_THAT(ValuesOf("2-4,9"), ElementsAre(2, 3, 4, 9));
  EXPECT_THAT(ValuesOf("-3"), ElementsAre(-3));
  EXPECT_THAT(ValuesOf("2.5,-0"), ElementsAre(0, 2.5));
  EXPECT_THAT(ValuesOf("left lung"), ElementsAre(3));
  EXPECT_THAT(ValuesOf("right LUNG, left lung,9"), ElementsAre(3, 4, 9));
  EXPECT_THAT(ValuesOf("a,b: c"), ElementsAre(6));  // the whole is a name
  EXPECT_THAT(ValuesOf("3-7"), ElementsAre(5));     // so is this range
}

TEST(LabelFlagsTest, AMisspeltNameIsAnsweredWithTheNearest) {
  EXPECT_THAT(ErrorOf("left lnug"),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("'left lnug'"), HasSubstr("did you mean 'left lung'?"))));
  EXPECT_THAT(ErrorOf("3,pancreas"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("'pancreas'")));
  EXPECT_THAT(ErrorOf("twin"), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("7, 8")));
  for (const char* text : {"7-3", "3,,7", "nan", "inf", "1-2-3", "3--7"}) {
    EXPECT_THAT(ErrorOf(text), StatusIs(absl::StatusCode::kInvalidArgument)) << text;
  }
  EXPECT_THAT(ErrorOf("0-256"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("more than 256 values")));
  EXPECT_THAT(ErrorOf("0-9223372036854775807"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("more than 256 values")));
  EXPECT_EQ(ValuesOf("0-255").size(), 256U);
  LabelFlags flags = FlagsOf({"lung"});
  EXPECT_THAT(ResolveLabels(v1::Dataset(), std::nullopt, &flags),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no names of labels")));
}

TEST(LabelFlagsTest, TheColourIsThatOfTheFlagOfTheDatasetOrOfTheValue) {
  LabelFlags flags = FlagsOf({"3", "4,3", "1", "3:0,0,1:0.5", "3::0.25"});
  ASSERT_THAT(ResolveLabels(Organs(), std::nullopt, &flags), IsOk());
  ASSERT_EQ(flags.surfaces.size(), 5U);
  EXPECT_EQ(flags.surfaces[0].color, (Color{1, 0, 0, 1}));
  EXPECT_EQ(flags.surfaces[1].color, (Color{1, 0, 0, 1}));
  EXPECT_EQ(flags.surfaces[2].color, (Color{0x2a / 255.0F, 0x89 / 255.0F, 0xe2 / 255.0F, 1}));
  EXPECT_EQ(flags.surfaces[3].color, (Color{0, 0, 1, 0.5F}));
  EXPECT_EQ(flags.surfaces[4].color, (Color{1, 0, 0, 0.25F}));
  EXPECT_EQ(flags.surfaces[0].name, "left lung");
  EXPECT_EQ(flags.surfaces[1].name, "left lung, Right lung");
  EXPECT_EQ(flags.surfaces[2].name, "label 1");
}

TEST(LabelFlagsTest, AllIsEachPresentValueOrElseEachNameButNot0) {
  LabelFlags flags{.wants_all = true};
  ASSERT_THAT(ResolveLabels(Organs(), std::vector<double>{0, 4, 9}, &flags), IsOk());
  ASSERT_EQ(flags.surfaces.size(), 2U);
  EXPECT_THAT(flags.surfaces[0].values, ElementsAre(4));
  EXPECT_THAT(flags.surfaces[1].values, ElementsAre(9));
  ASSERT_THAT(ResolveLabels(Organs(), std::nullopt, &flags), IsOk());
  EXPECT_EQ(flags.surfaces.size(), 6U);
  EXPECT_THAT(ResolveLabels(Organs(), std::vector<double>{0}, &flags),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("all samples are 0")));
  EXPECT_THAT(ResolveLabels(v1::Dataset(), std::nullopt, &flags),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("give --label with values")));
  std::vector<double> many;
  for (int i = 1; i <= 129; ++i) {
    many.push_back(i);
  }
  EXPECT_THAT(ResolveLabels(Organs(), many, &flags),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("there are 129 labels"), HasSubstr("--label 3,7-9"))));
  EXPECT_THAT(ResolveLabels(Organs(), many, &flags, /*max_surfaces=*/129), IsOk());
  EXPECT_EQ(flags.surfaces.size(), 129U);
  many.pop_back();
  EXPECT_THAT(ResolveLabels(Organs(), many, &flags), IsOk());
  EXPECT_THAT(ResolveLabels(v1::Dataset(), std::nullopt, &flags, 128, "a sample is 0.5"),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       HasSubstr("no names of labels, and a sample is 0.5: give --label")));
}

// A label that nobody gave a colour has one for pictures; formats without colours may drop it.
TEST(LabelFlagsTest, AColourIsKnownToBeGivenOrNot) {
  LabelFlags flags = FlagsOf({"3", "3:red", "3::0.5"});
  ASSERT_THAT(ResolveLabels(Organs(), std::nullopt, &flags), IsOk());
  EXPECT_FALSE(flags.surfaces[0].is_color_given);
  EXPECT_TRUE(flags.surfaces[1].is_color_given);
  EXPECT_FALSE(flags.surfaces[2].is_color_given);
}

TEST(LabelFlagsTest, NamesHaveAllDigitsOfALabel) {
  EXPECT_EQ(NameOfLabels({9007199254740992}, {}), "label 9007199254740992");
  EXPECT_EQ(NameOfLabels({1000000, 1234567891}, {}), "label 1000000, 1234567891");
  EXPECT_EQ(NameOfLabels({0.5}, {}), "label 0.5");
}

// Values of any type, as the coordinator lists them.
TEST(LabelFlagsTest, AListOfTheValuesTellsThemOfEveryType) {
  v1::Dataset dataset;
  dataset.set_sample_type(v1::SAMPLE_TYPE_FLOAT32);
  v1::GetHistogramResponse histogram;
  EXPECT_EQ(WhyNoLabels(histogram), "");
  histogram.mutable_label_values()->add_values(0);
  histogram.mutable_label_values()->add_values(16777216);
  EXPECT_EQ(PresentValues(dataset, histogram), (std::vector<double>{0, 16777216}));
  EXPECT_EQ(WhyNoLabels(histogram), "");
  histogram.mutable_label_values()->set_has_more(true);
  EXPECT_EQ(PresentValues(dataset, histogram), std::nullopt);
  EXPECT_EQ(WhyNoLabels(histogram), "its samples have more than 2 different values");
  histogram.mutable_label_values()->set_other_value(0.5);
  EXPECT_EQ(PresentValues(dataset, histogram), std::nullopt);
  EXPECT_EQ(WhyNoLabels(histogram),
            "a sample is 0.5, and labels are whole numbers from -2^53 to 2^53");
}

TEST(LabelFlagsTest, AHistogramHasABinForEachIntegerOfASmallRange) {
  v1::Dataset dataset;
  dataset.set_sample_type(v1::SAMPLE_TYPE_INT32);
  EXPECT_FALSE(HasExactBins(dataset));
  dataset.mutable_value_range()->set_min(-5);
  dataset.mutable_value_range()->set_max(4090);
  EXPECT_TRUE(HasExactBins(dataset));
  dataset.mutable_value_range()->set_max(4091);
  EXPECT_FALSE(HasExactBins(dataset));
  dataset.mutable_value_range()->set_max(3);
  dataset.set_sample_type(v1::SAMPLE_TYPE_FLOAT32);
  EXPECT_FALSE(HasExactBins(dataset));
}

TEST(LabelFlagsTest, OnlyAHistogramOfEachIntegerTellsTheValues) {
  v1::GetHistogramResponse histogram;
  histogram.set_has_sample_counts(true);
  for (int i = 0; i < 4; ++i) {
    v1::HistogramBin* const bin = histogram.add_bins();
    bin->set_min(i);
    bin->set_max(i + 1);
    bin->set_sample_count(i % 2 == 0 ? 0 : 5);
  }
  v1::Dataset dataset = Organs();
  EXPECT_EQ(PresentValues(dataset, histogram), (std::vector<double>{1, 3}));
  dataset.set_sample_type(v1::SAMPLE_TYPE_FLOAT32);
  EXPECT_EQ(PresentValues(dataset, histogram), std::nullopt);
  dataset.set_sample_type(v1::SAMPLE_TYPE_INT32);
  histogram.mutable_bins(3)->set_max(5);
  EXPECT_EQ(PresentValues(dataset, histogram), std::nullopt);
  histogram.mutable_bins(3)->set_max(4);
  histogram.set_has_sample_counts(false);
  EXPECT_EQ(PresentValues(dataset, histogram), std::nullopt);
}

TEST(LabelFlagsTest, SurfacesOfLabelsFollowThoseOfIsovalues) {
  RequestFlags flags{.isovalue = 60, .base_color = Color{0, 1, 0, 1}, .label = FlagsOf({"3"})};
  ASSERT_THAT(ResolveLabels(Organs(), std::nullopt, &flags.label), IsOk());
  ASSERT_THAT(CheckUsage(flags), IsOk());
  v1::RenderIsosurfaceRequest request = MakeRequest(flags, "organs", view::Camera());
  ASSERT_EQ(request.surfaces_size(), 2);
  EXPECT_EQ(request.surfaces(0).isovalue(), 60);
  EXPECT_EQ(request.surfaces(0).color().green(), 1);
  EXPECT_THAT(request.surfaces(1).labels(), ElementsAre(3));
  EXPECT_EQ(request.surfaces(1).isovalue(), 0);
  EXPECT_EQ(request.isovalue(), 0);
  EXPECT_FALSE(request.has_base_color());
  EXPECT_THAT(flags.isovalues(), ElementsAre(60));
  EXPECT_EQ(flags.surface_count(), 2U);

  RequestFlags alone{.label = flags.label};
  ASSERT_THAT(CheckUsage(alone), IsOk());
  request = MakeRequest(alone, "organs", view::Camera());
  ASSERT_EQ(request.surfaces_size(), 1);
  EXPECT_THAT(alone.isovalues(), ElementsAre());

  const v1::ExportIsosurfaceRequest mesh = MakeExportRequest(60, {}, {}, "organs", flags.label);
  ASSERT_EQ(mesh.surfaces_size(), 2);
  EXPECT_EQ(mesh.surfaces(0).isovalue(), 60);
  EXPECT_THAT(mesh.surfaces(1).labels(), ElementsAre(3));
}

TEST(LabelFlagsTest, FlagsThatContradictEachOtherAreWrongUsage) {
  const auto refuses = [](const RequestFlags& flags, const char* what) {
    const absl::Status status = CheckUsage(flags);
    EXPECT_TRUE(cli::IsUsageError(status));
    EXPECT_THAT(status.message(), HasSubstr(what));
  };
  LabelFlags both = FlagsOf({"3"});
  both.wants_all = true;
  refuses({.label = both}, "leave --label out");
  refuses({.base_color = Color{}, .label = FlagsOf({"3"})}, "--label SET:COLOR");
  std::vector<std::string> many;
  for (int i = 0; i < 128; ++i) {
    many.push_back(absl::StrCat(i));
  }
  EXPECT_THAT(CheckUsage(RequestFlags{.label = FlagsOf(many)}), IsOk());
  refuses({.isovalue = 1, .label = FlagsOf(many)}, "129 surfaces");
  many.push_back("128");
  refuses({.label = FlagsOf(many)}, "129 times");
  EXPECT_THAT(CheckUsage(FlagsOf(many), /*max_surfaces=*/129), IsOk());
  cli::FlagSet set({.has_help = false});
  LabelFlags flags;
  AddLabelFlags(&set, &flags);
  EXPECT_THAT(set.Parse({"--labels=3,7"}).message(), HasSubstr("--label 3,7"));
  EXPECT_THAT(set.Parse({"--labels=all"}), IsOk());
  EXPECT_TRUE(flags.wants_all);
}

TEST(LabelFlagsTest, SmoothOnesAreAllOrNone) {
  for (const bool smooths : {false, true}) {
    LabelFlags flags = FlagsOf({"3", "left lung"});
    flags.smooths = smooths;
    ASSERT_THAT(ResolveLabels(Organs(), std::nullopt, &flags), IsOk());
    LabelFlags all{.wants_all = true, .smooths = smooths};
    ASSERT_THAT(ResolveLabels(Organs(), std::nullopt, &all), IsOk());
    for (const LabelFlags* resolved : {&flags, &all}) {
      for (const LabelSurface& surface : resolved->surfaces) {
        v1::Surface proto;
        AddTo(surface, &proto);
        EXPECT_EQ(proto.smooth_labels(), smooths);
      }
    }
  }
  EXPECT_THAT(CheckUsage(LabelFlags{.smooths = true}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("--smooth-labels")));
}

}  // namespace
}  // namespace isoscope::client
