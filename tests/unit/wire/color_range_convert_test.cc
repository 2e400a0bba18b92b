// The ranges of colour maps: as requests say them, and as they follow from a dataset and its step.

#include "wire/color_range_convert.h"

#include <limits>
#include <string>
#include <tuple>
#include <utility>

#include "gmock/gmock.h"
#include "google/protobuf/text_format.h"
#include "gtest/gtest.h"

#include "core/base/status_macros.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/wire/wrong_fields.h"
#include "wire/frame_convert.h"

namespace isoscope::wire {
namespace {

using frame::RangeSource;
using isoscope::testing::StatusIs;
using ::testing::HasSubstr;
using ColorRange = isoscope::v1::ColorRange;

template <typename Samples>
void SetRange(double min, double max, Samples* samples) {
  samples->mutable_value_range()->set_min(min);
  samples->mutable_value_range()->set_max(max);
}

// A request with a box, whose caps show samples.
isoscope::v1::RenderIsosurfaceRequest CutRequest() {
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  request.mutable_clip()->mutable_box()->mutable_min();
  request.mutable_clip()->mutable_box()->mutable_max()->set_x(1);
  request.mutable_caps()->set_color_map(isoscope::v1::COLOR_MAP_GREY);
  return request;
}

TEST(AskedRangeTest, NumbersSourcesAndPercentilesArriveAndGoBack) {
  isoscope::v1::RenderIsosurfaceRequest request = CutRequest();
  ColorRange* const range = request.mutable_caps()->mutable_range();
  range->mutable_percentiles()->set_low(2.5);
  range->mutable_percentiles()->set_high(100);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(frame::FrameSpec spec, FrameSpecFromProto(request));
  EXPECT_EQ(spec.caps->percentiles, (frame::Percentiles{.low = 2.5, .high = 100}));
  EXPECT_FALSE(spec.caps->range.has_value());
  EXPECT_EQ(ToProto(*spec.caps).SerializeAsString(), request.caps().SerializeAsString());
  range->Clear();
  for (const auto& [source, expected] : {std::pair(ColorRange::SOURCE_STEP, RangeSource::kStep),
                                         {ColorRange::SOURCE_VISIBLE, RangeSource::kVisible}}) {
    range->set_source(source);
    request.clear_surfaces();
    request.set_isovalue(0);
    isoscope::v1::ColorBy& color_by = *request.add_surfaces()->mutable_color_by();
    color_by.set_quantity(isoscope::v1::ColorBy::QUANTITY_POSITION_Z);
    color_by.mutable_range()->set_source(source);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(spec, FrameSpecFromProto(request));
    EXPECT_EQ(spec.caps->range_source, expected);
    EXPECT_EQ(spec.surfaces[0].color_by->range_source, expected);
    EXPECT_EQ(ToProto(*spec.caps).range().source(), source);
    EXPECT_EQ(ToProto(*spec.surfaces[0].color_by).range().source(), source);
    EXPECT_EQ(HasVisibleRanges(spec), expected == RangeSource::kVisible);
  }
}

// Agents know numbers alone.
TEST(AskedRangeTest, ARangeThatWasFoundGoesOutAsNumbers) {
  const frame::ClipCaps caps{.map = frame::ColorMap::kGrey,
                             .range = frame::ColorRange{1, 3},
                             .percentiles = frame::Percentiles()};
  EXPECT_EQ(ToProto(caps).range().max(), 3);
  EXPECT_FALSE(ToProto(caps).range().has_percentiles());
  const frame::ColorBy color_by{.range = frame::ColorRange{1, 3},
                                .range_source = RangeSource::kStep};
  EXPECT_EQ(ToProto(color_by).range().min(), 1);
  EXPECT_EQ(ToProto(color_by).range().source(), ColorRange::SOURCE_UNSPECIFIED);
}

TEST(AskedRangeTest, HostileRangesAreNamed) {
  const auto expect = [](const char* text, const std::string& message) {
    isoscope::v1::RenderIsosurfaceRequest request = CutRequest();
    ASSERT_TRUE(google::protobuf::TextFormat::ParseFromString(
        text, request.mutable_caps()->mutable_range()));
    EXPECT_THAT(FrameSpecFromProto(request),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(message)))
        << text;
  };
  expect("source: 3", "caps.range.source is 3: must be 0 (min and max), 1 (step) or 2 (visible)");
  expect("source: SOURCE_STEP max: 2",
         "caps.range.max is 2 beside caps.range.source 1, which finds both ends: must be unset");
  expect("percentiles {high: 98} min: 1", "caps.range.min is 1 beside caps.range.percentiles");
  expect("percentiles {high: 98} source: SOURCE_VISIBLE",
         "caps.range.percentiles is set beside caps.range.source 2: must be unset");
  expect("percentiles {low: -1 high: 98}",
         "caps.range.percentiles.low is -1: must lie in [0, 100)");
  expect("percentiles {low: nan high: 98}", "caps.range.percentiles.low is nan");
  expect("percentiles {low: 100 high: 100}", "caps.range.percentiles.low is 100");
  expect("percentiles {low: 2 high: 2}", "caps.range.percentiles.high is 2: must lie in (2, 100]");
  expect("percentiles {high: 100.5}", "caps.range.percentiles.high is 100.5");
  expect("percentiles {high: nan}", "caps.range.percentiles.high is nan");
  expect("", "caps.range.max is 0: must be greater than caps.range.min");
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  request.set_isovalue(0);
  isoscope::v1::ColorBy& color_by = *request.add_surfaces()->mutable_color_by();
  color_by.set_quantity(isoscope::v1::ColorBy::QUANTITY_POSITION_Z);
  color_by.mutable_range()->mutable_percentiles()->set_high(98);
  EXPECT_THAT(FrameSpecFromProto(request),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       HasSubstr("surfaces[0].color_by.range.percentiles is set: must be unset")));
}

// The regions of a poster would not fit together.
TEST(AskedRangeTest, ARegionHasNoRangeOfWhatIsVisible) {
  isoscope::v1::RenderIsosurfaceRequest request = CutRequest();
  request.mutable_region()->set_width_px(1);
  request.mutable_region()->set_height_px(1);
  request.mutable_caps()->mutable_range()->set_source(ColorRange::SOURCE_VISIBLE);
  EXPECT_THAT(FrameSpecFromProto(request),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("region is set beside")));
  request.mutable_caps()->mutable_range()->set_source(ColorRange::SOURCE_STEP);
  EXPECT_THAT(FrameSpecFromProto(request), isoscope::testing::IsOk());
}

TEST(ResolveColorRangesTest, AStepHasItsOwnRangesAndWhatIsVisibleBeginsWithThoseOfAll) {
  isoscope::v1::RenderIsosurfaceRequest request = CutRequest();
  request.set_isovalue(0);
  isoscope::v1::ColorBy& color_by = *request.add_surfaces()->mutable_color_by();
  color_by.set_quantity(isoscope::v1::ColorBy::QUANTITY_GRADIENT_MAGNITUDE);
  isoscope::v1::Dataset dataset;
  SetRange(-3, 8, &dataset);
  dataset.set_max_gradient_magnitude(12);
  isoscope::v1::FieldComponent at_step;
  SetRange(-1, std::numeric_limits<double>::infinity(), &at_step);
  at_step.mutable_finite_range()->set_max(2);
  at_step.set_max_gradient_magnitude(5);
  for (const auto& [source, caps, gradient] :
       {std::tuple(ColorRange::SOURCE_STEP, frame::ColorRange{0, 2}, frame::ColorRange{0, 5}),
        {ColorRange::SOURCE_VISIBLE, frame::ColorRange{-3, 8}, frame::ColorRange{0, 12}}}) {
    request.mutable_caps()->mutable_range()->set_source(source);
    color_by.mutable_range()->set_source(source);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(frame::FrameSpec spec, FrameSpecFromProto(request));
    ISOSCOPE_ASSERT_OK(ResolveColorRanges(dataset, at_step, &spec));
    EXPECT_EQ(spec.caps->range, caps);
    EXPECT_EQ(spec.surfaces[0].color_by->range, gradient);
    EXPECT_EQ(HasVisibleRanges(spec), source == ColorRange::SOURCE_VISIBLE);
  }
  request.mutable_caps()->mutable_range()->Clear();
  request.mutable_caps()->mutable_range()->mutable_percentiles()->set_high(50);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(frame::FrameSpec spec, FrameSpecFromProto(request));
  ISOSCOPE_ASSERT_OK(ResolveColorRanges(dataset, at_step, &spec));
  EXPECT_FALSE(spec.caps->range.has_value()) << "percentiles need the samples";
}

TEST(RangesOfTest, ADatasetWithoutFieldsIsItsOnlyStep) {
  isoscope::v1::Dataset dataset;
  EXPECT_FALSE(RangesOf(dataset).has_value_range());
  EXPECT_FALSE(RangesOf(dataset).has_max_gradient_magnitude());
  SetRange(1, 4, &dataset);
  dataset.mutable_finite_range()->set_max(3);
  dataset.set_max_gradient_magnitude(0);
  const isoscope::v1::FieldComponent ranges = RangesOf(dataset);
  EXPECT_EQ(ranges.value_range().max(), 4);
  EXPECT_EQ(ranges.finite_range().max(), 3);
  EXPECT_TRUE(ranges.has_max_gradient_magnitude());
}

TEST(ResolveColorRangesTest, TheGradientsMapEndsAtTheDatasetsBound) {
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  request.set_isovalue(0);
  const frame::ColorBy by_gradient{.quantity = frame::ColorBy::Quantity::kGradientMagnitude,
                                   .map = frame::ColorMap::kTurbo};
  frame::ColorBy with_range = by_gradient;
  with_range.range = frame::ColorRange{3, 4};
  request.add_surfaces();
  *request.add_surfaces()->mutable_color_by() = ToProto(by_gradient);
  *request.add_surfaces()->mutable_color_by() = ToProto(with_range);
  *request.add_surfaces()->mutable_color_by() = ToProto(frame::ColorBy());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::FrameSpec spec, FrameSpecFromProto(request));
  isoscope::v1::Dataset dataset;
  dataset.set_name("ct");
  for (const double bound : {12.5, 0.0}) {
    dataset.set_max_gradient_magnitude(bound);
    frame::FrameSpec resolved = spec;
    ISOSCOPE_ASSERT_OK(ResolveColorRanges(dataset, {}, &resolved));
    EXPECT_EQ(resolved.surfaces[1].color_by->range, (frame::ColorRange{0, bound > 0 ? bound : 1}));
    EXPECT_EQ(resolved.surfaces[2].color_by, with_range);
    EXPECT_FALSE(resolved.surfaces[3].color_by->range.has_value());
  }
}

TEST(ColorRangeOfTest, HoldsTheValuesOfAllSteps) {
  for (const auto& [min, max] : {std::pair(-1.0, 2.0), {3.0, 3.0}}) {
    isoscope::v1::FieldComponent component;
    SetRange(min, max, &component);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::ColorRange range, ColorRangeOf(component, "range"));
    EXPECT_EQ(range, frame::ColorRangeOfSamples(min, max));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::ColorRange nan_range, ColorRangeOf({}, "range"));
  EXPECT_EQ(nan_range, (frame::ColorRange{0, 1}));
}

// Symptom: a single infinite sample stretched the range, and all others had one colour.
TEST(ColorRangeOfTest, InfiniteSamplesDoNotCount) {
  constexpr double kInf = std::numeric_limits<double>::infinity();
  for (const auto& [min, max] : {std::pair(0.0, kInf), {-kInf, 5.0}, {-kInf, kInf}}) {
    isoscope::v1::FieldComponent component;
    SetRange(min, max, &component);
    EXPECT_THAT(ColorRangeOf(component, "surfaces[0].color_by.range"),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         HasSubstr("surfaces[0].color_by.range is not set: required, because there "
                                   "are infinite samples")));
    component.mutable_finite_range()->set_min(2);
    component.mutable_finite_range()->set_max(4);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::ColorRange range, ColorRangeOf(component, "range"));
    EXPECT_EQ(range, (frame::ColorRange{2, 4}));
  }
}

TEST(ResolveColorRangesTest, TheMapOfCapsHasTheRangeOfTheDatasetsFiniteSamples) {
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  request.mutable_clip()->mutable_box()->mutable_min();
  request.mutable_clip()->mutable_box()->mutable_max()->set_x(1);
  request.mutable_caps()->set_color_map(isoscope::v1::COLOR_MAP_TURBO);
  isoscope::v1::Dataset dataset;
  SetRange(-3, 8, &dataset);
  const auto resolved = [&]() -> absl::StatusOr<frame::FrameSpec> {
    ISOSCOPE_ASSIGN_OR_RETURN(frame::FrameSpec spec, FrameSpecFromProto(request));
    ISOSCOPE_RETURN_IF_ERROR(ResolveColorRanges(dataset, {}, &spec));
    return spec;
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(frame::FrameSpec spec, resolved());
  EXPECT_EQ(spec.caps->range, (frame::ColorRange{-3, 8}));
  SetRange(-3, std::numeric_limits<double>::infinity(), &dataset);
  EXPECT_THAT(resolved(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("caps.range")));
  dataset.mutable_finite_range()->set_max(7);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(spec, resolved());
  EXPECT_EQ(spec.caps->range, (frame::ColorRange{0, 7}));
  request.mutable_caps()->mutable_range()->set_max(2);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(spec, resolved());
  EXPECT_EQ(spec.caps->range, (frame::ColorRange{0, 2}));
  request.mutable_caps()->Clear();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(spec, resolved());
  EXPECT_EQ(spec.caps, frame::ClipCaps()) << "caps with the look of the surface have no range";
}

TEST(ResolveColorRangesTest, ADatasetWithoutTheBoundNeedsARange) {
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest();
  request.set_isovalue(0);
  request.add_surfaces()->mutable_color_by()->set_quantity(
      isoscope::v1::ColorBy::QUANTITY_GRADIENT_MAGNITUDE);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(frame::FrameSpec spec, FrameSpecFromProto(request));
  isoscope::v1::Dataset dataset;
  dataset.set_name("ct");
  EXPECT_THAT(ResolveColorRanges(dataset, {}, &spec),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       HasSubstr("surfaces[0].color_by.range is not set: required, because dataset "
                                 "'ct'")));
  request.mutable_surfaces(0)->mutable_color_by()->mutable_range()->set_max(2);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(spec, FrameSpecFromProto(request));
  ISOSCOPE_EXPECT_OK(ResolveColorRanges(dataset, {}, &spec));
}

}  // namespace
}  // namespace isoscope::wire
