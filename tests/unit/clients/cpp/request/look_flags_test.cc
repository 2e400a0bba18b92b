#include "clients/cpp/request/look_flags.h"

#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/cli/usage.h"
#include "tests/support/status_matchers.h"
#include "wire/first_look.h"
#include "wire/frame_convert.h"
#include "wire/proto_convert.h"

namespace isoscope::client {
namespace {

using frame::ColorBy;
using frame::ColorMap;
using frame::Light;
using isoscope::testing::StatusIs;
using ::testing::HasSubstr;

TEST(LookFlagsTest, LightsHaveDirectionIntensityAndColor) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Light plain, ParseLight("1,-2,0.5"));
  EXPECT_EQ(plain, (Light{.direction = {1, -2, 0.5}}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Light orange, ParseLight("0,0,1:0.25:1,0.5,0"));
  EXPECT_EQ(orange,
            (Light{.direction = {0, 0, 1}, .intensity = 0.25F, .color = {255, 128, 0, 255}}));
  for (const char* text :
       {"", "1,2", "0,0,0", "1e300,0,0", "1e-300,0,0", "nan,0,1", "1,2,3,4", "1,2,3:", "1,2,3:-1",
        "1,2,3:10.5", "1,2,3:inf", "1,2,3:1:2,0,0", "1,2,3:1:1,1,1:1"}) {
    EXPECT_THAT(ParseLight(text), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("'")))
        << text;
  }
}

// Half of a level: the float 0.7 is a little less, so that the server takes 178.
TEST(LookFlagsTest, TheColorOfALightIsRoundedAsTheServerDoes) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Light light, ParseLight("0,0,1:1:0.7,0.3,0.1"));
  EXPECT_EQ(light.color, (image::Rgba8{178, 77, 26, 255}));
}

TEST(LookFlagsTest, ColorByHasQuantityMapAndRange) {
  const std::vector<std::pair<const char*, ColorByValue>> right = {
      {"z", {ColorBy{.quantity = ColorBy::Quantity::kPositionZ}}},
      {"x:cool-warm:-3,4.5",
       {ColorBy{.quantity = ColorBy::Quantity::kPositionX,
                .map = ColorMap::kCoolWarm,
                .range = frame::ColorRange{-3, 4.5}}}},
      {"y:grey:0,1:0.25,1",
       {ColorBy{.quantity = ColorBy::Quantity::kPositionY,
                .map = ColorMap::kGrey,
                .range = frame::ColorRange{0, 1},
                .opacity_at_min = 0.25F}}},
      {"z:magma::1,0",
       {ColorBy{.quantity = ColorBy::Quantity::kPositionZ,
                .map = ColorMap::kMagma,
                .opacity_at_max = 0}}},
      {"gradient:turbo",
       {ColorBy{.quantity = ColorBy::Quantity::kGradientMagnitude, .map = ColorMap::kTurbo}}},
      {"normal", {ColorBy{.quantity = ColorBy::Quantity::kNormal}}},
      {"none", {}},
      {"w", {ColorBy{}, "w"}},
      {"temperature:magma:1,2",
       {ColorBy{.map = ColorMap::kMagma, .range = frame::ColorRange{1, 2}}, "temperature"}},
      {"velocity:x", {ColorBy{}, "velocity:x"}},
      {"velocity:magnitude:turbo::0,1",
       {ColorBy{.map = ColorMap::kTurbo, .opacity_at_min = 0}, "velocity:magnitude"}},
      // Names with colons, and one that ends like a map.
      {"a:b:c", {ColorBy{}, "a:b:c"}},
      {"a:b:c:turbo", {ColorBy{.map = ColorMap::kTurbo}, "a:b:c"}},
      {"a:turbo:magma:1,2",
       {ColorBy{.map = ColorMap::kMagma, .range = frame::ColorRange{1, 2}}, "a:turbo"}}};
  for (const auto& [text, expected] : right) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ColorByValue value, ParseColorBy(text));
    EXPECT_EQ(value, expected) << text;
  }
  for (const char* text : {"",
                           ":magma",
                           "w:",
                           "w:x:magma:2,1",
                           "x:",
                           "x:jet",
                           "x:turbo:",
                           "x:turbo:1",
                           "x:turbo:2,2",
                           "x:turbo:3,2",
                           "x:turbo:nan,2",
                           "x:turbo:-1e308,1e308",
                           "x:turbo:1,2:3",
                           "x:turbo:1,2:",
                           "x:turbo::",
                           "x:turbo::-0.1,1",
                           "x:turbo::0,1.1",
                           "x:turbo::nan,1",
                           "x:turbo::0,1,1",
                           "x:turbo:1,2:0,1:1",
                           "normal:turbo",
                           "normal:::0,1",
                           "none:turbo"}) {
    EXPECT_THAT(ParseColorBy(text), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("'")))
        << text;
  }
}

TEST(LookFlagsTest, CapsHaveAMapAndARangeOrNothing) {
  const std::vector<std::pair<const char*, frame::ClipCaps>> right = {
      {"", {}},
      {"grey", {.map = ColorMap::kGrey}},
      {"cool-warm:-3,4.5", {.map = ColorMap::kCoolWarm, .range = frame::ColorRange{-3, 4.5}}}};
  for (const auto& [text, expected] : right) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::ClipCaps caps, ParseCaps(text));
    EXPECT_EQ(caps, expected) << text;
  }
  for (const char* text : {"jet", "grey:", "grey:1", "grey:2,2", "grey:3,2", "grey:nan,2",
                           "grey:-1e308,1e308", "grey:1,2:3", ":1,2", "x:grey"}) {
    EXPECT_THAT(ParseCaps(text), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("'")))
        << text;
  }
}

TEST(LookFlagsTest, EveryMapHasItsName) {
  for (const char* name : {"viridis", "magma", "cividis", "turbo", "cool-warm", "grey"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ColorByValue value, ParseColorBy(std::string("y:") + name));
    EXPECT_EQ(NameOf(value.color_by->map), name);
  }
}

TEST(LookFlagsTest, OneColorByIsForAllSurfacesOrThereIsOneForEach) {
  LookFlags flags;
  flags.color_by.resize(1);
  ISOSCOPE_EXPECT_OK(CheckUsage(flags, 3, /*has_sample_caps=*/false));
  flags.color_by.resize(2);
  EXPECT_TRUE(cli::IsUsageError(CheckUsage(flags, 3, /*has_sample_caps=*/false)));
  EXPECT_TRUE(cli::IsUsageError(CheckUsage(flags, 1, /*has_sample_caps=*/false)));
  ISOSCOPE_EXPECT_OK(CheckUsage(flags, 2, /*has_sample_caps=*/false));
  flags.lights.resize(5);
  EXPECT_TRUE(cli::IsUsageError(CheckUsage(flags, 2, /*has_sample_caps=*/false)));
  EXPECT_TRUE(cli::IsUsageError(
      CheckUsage(LookFlags{.light_space = Light::Space::kWorld}, 1, /*has_sample_caps=*/false)));
}

TEST(LookFlagsTest, TheRequestSaysWhatTheFlagsSay) {
  LookFlags flags;
  flags.lights = {{.direction = {1, 2, 3}, .intensity = 0.5F}, {.color = {255, 0, 0, 255}}};
  flags.light_space = Light::Space::kWorld;
  flags.color_by = {{ColorBy{.quantity = ColorBy::Quantity::kPositionY}}};
  isoscope::v1::RenderIsosurfaceRequest request;
  request.set_isovalue(60);
  request.mutable_base_color()->set_red(1);
  request.mutable_base_color()->set_alpha(1);
  request.mutable_viewport()->set_width_px(10);
  request.mutable_viewport()->set_height_px(10);
  AddLook({}, &request);
  EXPECT_EQ(request.isovalue(), 60) << "without flags the request stays what it was";
  AddLook(flags, &request);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const frame::FrameSpec spec, wire::FrameSpecFromProto(request));
  for (Light& light : flags.lights) {
    light.space = Light::Space::kWorld;
  }
  EXPECT_EQ(spec.lights, flags.lights);
  ASSERT_EQ(spec.surfaces.size(), 1U);
  EXPECT_EQ(spec.surfaces[0].rule.isovalue, 60);
  EXPECT_EQ(spec.surfaces[0].appearance.base_color, (image::Rgba8{255, 0, 0, 255}));
  EXPECT_EQ(spec.surfaces[0].color_by, flags.color_by[0].color_by);
}

TEST(LookFlagsTest, TheSoftMaterialIsThatOfTheFirstLookForAllSurfaces) {
  isoscope::v1::RenderIsosurfaceRequest plain;
  plain.set_isovalue(5);
  plain.mutable_base_color()->set_red(1);
  isoscope::v1::RenderIsosurfaceRequest request = plain;
  AddLook({.material = MaterialChoice::kGlossy}, &request);
  EXPECT_EQ(request.SerializeAsString(), plain.SerializeAsString()) << "the server's default";
  AddLook({.material = MaterialChoice::kSoft}, &request);
  ASSERT_EQ(request.surfaces_size(), 1);
  EXPECT_EQ(request.isovalue(), 0);
  EXPECT_EQ(request.surfaces(0).isovalue(), 5);
  EXPECT_EQ(request.surfaces(0).color().red(), 1);
  EXPECT_EQ(request.surfaces(0).material().specular(), wire::GetFirstLook().specular());
  EXPECT_EQ(request.surfaces(0).material().diffuse(), wire::GetFirstLook().diffuse());
}

TEST(LookFlagsTest, AFieldIsNamedAndTheDatasetMustHaveSome) {
  LookFlags flags;
  flags.color_by = {{ColorBy{.map = ColorMap::kTurbo}, "velocity", "x"}};
  isoscope::v1::RenderIsosurfaceRequest request;
  request.add_surfaces();
  AddLook(flags, &request);
  EXPECT_EQ(request.surfaces(0).color_by().ShortDebugString(),
            "quantity: QUANTITY_FIELD color_map: COLOR_MAP_TURBO field: \"velocity\" component: "
            "\"x\"");
  isoscope::v1::Dataset dataset;
  EXPECT_THAT(CheckColorFields(flags, dataset),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       HasSubstr("--color-by 'velocity' is none of: x, y, z")));
  dataset.add_fields()->set_name("pressure");
  ISOSCOPE_EXPECT_OK(CheckColorFields(flags, dataset)) << "names are the server's to check";
}

TEST(LookFlagsTest, AColorOfMissingValuesNeedsAMapThatShowsSamples) {
  cli::FlagSet set;
  LookFlags flags;
  AddLookFlags(&set, &flags);
  ISOSCOPE_ASSERT_OK(set.Parse({"--nan-color", "#ff8000"}));
  for (const bool has_sample_caps : {false, true}) {
    EXPECT_EQ(CheckUsage(flags, 1, has_sample_caps).ok(), has_sample_caps);
  }
  flags.color_by = {{ColorBy{.quantity = ColorBy::Quantity::kPositionY}}};
  EXPECT_TRUE(cli::IsUsageError(CheckUsage(flags, 1, /*has_sample_caps=*/false)));
  flags.color_by = {{ColorBy{}, "velocity", "x"}};
  ISOSCOPE_EXPECT_OK(CheckUsage(flags, 1, /*has_sample_caps=*/false));
  isoscope::v1::RenderIsosurfaceRequest request;
  AddLook(flags, &request);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::Rgba8 color,
                                wire::ColorFromProto(request.nan_color(), "nan_color"));
  EXPECT_EQ(color, (image::Rgba8{255, 128, 0, 255}));
  isoscope::v1::RenderIsosurfaceRequest without;
  AddLook({}, &without);
  EXPECT_FALSE(without.has_nan_color());
}

TEST(LookFlagsTest, AWindowHasTwoPercentagesOrIsNone) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(CapWindow window, ParseCapWindow("0.5,100"));
  EXPECT_EQ(window.percentiles, (frame::Percentiles{.low = 0.5, .high = 100}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(window, ParseCapWindow("none"));
  EXPECT_EQ(window, CapWindow());
  for (const char* text : {"", "2", "2,98,99", "98,2", "2,2", "-1,98", "2,101", "nan,98", "all"}) {
    EXPECT_THAT(ParseCapWindow(text),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("LOW,HIGH")))
        << text;
  }
}

// A request whose caps show samples, and whose surfaces show x, from 0 to 1, and their normal.
isoscope::v1::RenderIsosurfaceRequest CutWith(const LookFlags& given) {
  LookFlags flags = given;
  flags.color_by = {{ColorBy{}},
                    {ColorBy{.range = frame::ColorRange{0, 1}}},
                    {ColorBy{.quantity = ColorBy::Quantity::kNormal}}};
  isoscope::v1::RenderIsosurfaceRequest request;
  for (int i = 0; i < 3; ++i) {
    request.add_surfaces();
  }
  request.mutable_caps()->set_color_map(isoscope::v1::COLOR_MAP_TURBO);
  AddLook(flags, &request);
  return request;
}

TEST(LookFlagsTest, ARangeIsThatOfAllMapsWithoutOneOfTheirOwn) {
  using isoscope::v1::ColorRange;
  EXPECT_FALSE(CutWith({}).caps().has_range()) << "the server's defaults";
  EXPECT_FALSE(CutWith({}).surfaces(0).color_by().has_range());
  const LookFlags visible{.color_range = frame::RangeSource::kVisible};
  const isoscope::v1::RenderIsosurfaceRequest request = CutWith(visible);
  EXPECT_EQ(request.caps().ShortDebugString(),
            "color_map: COLOR_MAP_TURBO range { source: SOURCE_VISIBLE }");
  EXPECT_EQ(request.surfaces(0).color_by().range().source(), ColorRange::SOURCE_VISIBLE);
  EXPECT_EQ(request.surfaces(1).color_by().range().ShortDebugString(), "max: 1");
  EXPECT_FALSE(request.surfaces(2).color_by().has_range());
  EXPECT_TRUE(HasVisibleRange(request));
  EXPECT_FALSE(HasVisibleRange(CutWith({.color_range = frame::RangeSource::kStep})));
  EXPECT_EQ(CutWith({.color_range = frame::RangeSource::kAllSteps}).SerializeAsString(),
            CutWith({}).SerializeAsString());
}

TEST(LookFlagsTest, AWindowIsThatOfCapsAndComesBeforeTheRange) {
  const LookFlags window{.color_range = frame::RangeSource::kStep,
                         .cap_window = CapWindow{.percentiles = frame::Percentiles()}};
  EXPECT_EQ(CutWith(window).caps().range().ShortDebugString(), "percentiles { low: 2 high: 98 }");
  const LookFlags none{.color_range = frame::RangeSource::kStep, .cap_window = CapWindow()};
  EXPECT_FALSE(CutWith(none).caps().has_range());
  isoscope::v1::RenderIsosurfaceRequest plain;
  plain.mutable_caps();
  AddLook(window, &plain);
  EXPECT_FALSE(plain.caps().has_range()) << "caps with the colour of their surface";
}

TEST(LookFlagsTest, TheCommonWindowIsForCapsThatNoFlagSays) {
  const auto range_with = [](const LookFlags& flags) {
    isoscope::v1::RenderIsosurfaceRequest request = CutWith(flags);
    AddCommonCapWindow(flags, &request);
    return request.caps().range().ShortDebugString();
  };
  EXPECT_EQ(range_with({}), "percentiles { low: 2 high: 98 }");
  EXPECT_EQ(range_with({.cap_window = CapWindow()}), "");
  EXPECT_EQ(range_with({.color_range = frame::RangeSource::kAllSteps}), "");
  isoscope::v1::RenderIsosurfaceRequest request = CutWith({});
  request.mutable_caps()->mutable_range()->set_max(3);
  AddCommonCapWindow({}, &request);
  EXPECT_EQ(request.caps().range().ShortDebugString(), "max: 3");
}

TEST(LookFlagsTest, RangesAndWindowsNeedAMap) {
  const LookFlags range{.color_range = frame::RangeSource::kStep};
  EXPECT_TRUE(cli::IsUsageError(CheckUsage(range, 1, /*has_sample_caps=*/false)));
  ISOSCOPE_EXPECT_OK(CheckUsage(range, 1, /*has_sample_caps=*/true));
  LookFlags colored = range;
  colored.color_by = {{ColorBy{.quantity = ColorBy::Quantity::kNormal}}};
  EXPECT_TRUE(cli::IsUsageError(CheckUsage(colored, 1, /*has_sample_caps=*/false)));
  colored.color_by = {{ColorBy{}}};
  ISOSCOPE_EXPECT_OK(CheckUsage(colored, 1, /*has_sample_caps=*/false));
  const LookFlags window{.cap_window = CapWindow()};
  EXPECT_TRUE(cli::IsUsageError(CheckUsage(window, 1, /*has_sample_caps=*/false)));
  ISOSCOPE_EXPECT_OK(CheckUsage(window, 1, /*has_sample_caps=*/true));
}

// Symptom: the colours of a film meant something else in each frame.
TEST(LookFlagsTest, LaterFramesKeepTheRangesOfThePicture) {
  isoscope::v1::RenderIsosurfaceResponse answer;
  answer.mutable_caps_coloring()->mutable_caps()->mutable_range()->set_max(110);
  isoscope::v1::SurfaceColoring& coloring = *answer.add_colorings();
  coloring.mutable_color_by()->mutable_range()->set_max(7);
  isoscope::v1::RenderIsosurfaceRequest request =
      CutWith({.color_range = frame::RangeSource::kVisible});
  KeepRanges({}, &request);
  EXPECT_TRUE(HasVisibleRange(request)) << "there is no answer yet";
  KeepRanges(answer, &request);
  EXPECT_EQ(request.caps().range().ShortDebugString(), "max: 110");
  EXPECT_EQ(request.surfaces(0).color_by().range().ShortDebugString(), "max: 7");
  EXPECT_FALSE(HasVisibleRange(request));
  request = CutWith({.color_range = frame::RangeSource::kStep});
  KeepRanges(answer, &request);
  EXPECT_EQ(request.caps().range().ShortDebugString(), "source: SOURCE_STEP")
      << "each step has its own";
  coloring.set_surface_index(1000);
  KeepRanges(answer, &request);
}

TEST(LookFlagsTest, ASurfaceMayKeepItsColor) {
  LookFlags flags;
  flags.color_by = {{}, {ColorBy{.quantity = ColorBy::Quantity::kNormal}}};
  isoscope::v1::RenderIsosurfaceRequest request;
  request.add_surfaces();
  request.add_surfaces();
  AddLook(flags, &request);
  EXPECT_FALSE(request.surfaces(0).has_color_by());
  EXPECT_TRUE(request.surfaces(1).has_color_by());
}

}  // namespace
}  // namespace isoscope::client
