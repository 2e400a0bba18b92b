#include "core/frame/frame_spec.h"

#include <cstdint>
#include <limits>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::frame {
namespace {

using isoscope::testing::IsOk;
using isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::StartsWith;

TEST(FrameSpecTest, RulesKeepTheOrderOfTheSurfaces) {
  FrameSpec spec;
  spec.surfaces.resize(3);
  spec.surfaces[0].rule.isovalue = 3;
  spec.surfaces[1].rule = volume::InsideRule::OfLabels({7, 2});
  spec.surfaces[2].rule.isovalue = -1.5;
  EXPECT_THAT(RulesOf(spec),
              ElementsAre(spec.surfaces[0].rule, spec.surfaces[1].rule, spec.surfaces[2].rule));
  EXPECT_EQ(TextOf(RulesOf(spec)), "isovalue 3; labels 2, 7; isovalue -1.5");
}

TEST(FrameSpecTest, TheTextOfManyRulesStaysShort) {
  EXPECT_THAT(TextOf(std::vector<volume::InsideRule>(kMaxSurfaces)),
              AllOf(StartsWith("isovalue 0; isovalue 0"), EndsWith("; and 112 more")));
}

TEST(FrameSpecTest, AFrameWithoutItsLookHasNoEffectsAndCapsOfSurfaces) {
  FrameSpec spec;
  spec.surfaces.resize(1);
  FrameSpec expected = spec;
  expected.sends_normals = true;
  spec.effects = {
      .samples_per_side = 4, .ambient_occlusion = AmbientOcclusion(), .silhouette = Silhouette()};
  EXPECT_EQ(WithoutLook(spec, /*sends_normals=*/true), expected);
  spec.caps = {.map = ColorMap::kGrey, .range = ColorRange{1, 2}};
  expected.caps.emplace();
  expected.sends_normals = false;
  EXPECT_EQ(WithoutLook(spec, /*sends_normals=*/false), expected);
}

TEST(FrameSpecTest, CapsWithSamplesHaveOwnersOfTheirOwn) {
  FrameSpec spec;
  spec.surfaces.resize(3);
  EXPECT_EQ(OwnerSurfaceCount(spec), 3U);
  spec.caps.emplace();
  EXPECT_EQ(OwnerSurfaceCount(spec), 3U);
  spec.caps->map = ColorMap::kGrey;
  EXPECT_EQ(OwnerSurfaceCount(spec), 6U);
}

TEST(FrameSpecTest, OwnersThatDoNotFitIn32BitsAreRefused) {
  constexpr std::int64_t kMax = std::numeric_limits<std::uint32_t>::max();
  EXPECT_THAT(CheckOwners(1, kMax), IsOk());
  EXPECT_THAT(CheckOwners(16, kMax / 16), IsOk());
  EXPECT_THAT(CheckOwners(1, kMax + 1),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       HasSubstr("1 surfaces of a volume of 4294967296")));
  EXPECT_THAT(CheckOwners(16, kMax / 16 + 1),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("at most 15 surfaces")));
  EXPECT_THAT(CheckOwners(2, std::numeric_limits<std::int64_t>::max()),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("at most 0 surfaces")));
}

TEST(FrameSpecTest, MissingValuesAreGreyOrPurpleBesideAMapThatHasThisGrey) {
  FrameSpec spec;
  for (const ColorMap map :
       {ColorMap::kViridis, ColorMap::kMagma, ColorMap::kTurbo, ColorMap::kCoolWarm}) {
    EXPECT_EQ(NanColorOf(spec, map), (image::Rgba8{128, 128, 128, 255}));
  }
  for (const ColorMap map : {ColorMap::kGrey, ColorMap::kCividis}) {
    EXPECT_EQ(NanColorOf(spec, map), (image::Rgba8{128, 0, 128, 255}));
  }
  spec.nan_color = image::Rgba8{1, 2, 3, 255};
  EXPECT_EQ(NanColorOf(spec, ColorMap::kGrey), *spec.nan_color);
}

TEST(InStoredValuesTest, IsovaluesAndRangesOfSamplesAreScaledExactly) {
  FrameSpec spec;
  spec.surfaces.resize(5);
  spec.surfaces[0].rule.isovalue = 127.3;
  spec.surfaces[1].rule = volume::InsideRule::OfLabels({3, 7});
  spec.surfaces[2].color_by =
      ColorBy{.quantity = ColorBy::Quantity::kGradientMagnitude, .range = ColorRange{0.5, 3}};
  spec.surfaces[3].color_by =
      ColorBy{.quantity = ColorBy::Quantity::kField, .range = ColorRange{-1, 2}};
  spec.surfaces[4].color_by =
      ColorBy{.quantity = ColorBy::Quantity::kPositionY, .range = ColorRange{10, 20}};
  spec.caps = ClipCaps{.map = ColorMap::kGrey, .range = ColorRange{0, 255}};

  FrameSpec expected = spec;
  expected.surfaces[0].rule.isovalue = 127.3 * 256;
  expected.surfaces[2].color_by->range = ColorRange{128, 768};
  expected.surfaces[3].color_by->range = ColorRange{-4, 8};
  expected.caps->range = ColorRange{0, 65280};
  EXPECT_EQ(InStoredValues(spec, 256, {1, 1, 1, 4, 1}), expected);
  EXPECT_EQ(InStoredValues(spec, 1, {}), spec);
  // It can be undone: nothing is rounded.
  EXPECT_EQ(InStoredValues(expected, 1.0 / 256, {1, 1, 1, 0.25, 1}), spec);
}

TEST(InStoredValuesTest, TheLargestNumbersStayFiniteAndInOrder) {
  constexpr double kLargest = std::numeric_limits<double>::max();
  EXPECT_EQ(InStoredValues(volume::InsideRule::OfIsovalue(kLargest), 256).isovalue, kLargest);
  EXPECT_EQ(InStoredValues(volume::InsideRule::OfIsovalue(-kLargest), 256).isovalue, -kLargest);
  FrameSpec spec;
  for (const ColorRange& range : {ColorRange{kLargest / 2, kLargest}, ColorRange{-kLargest, -1e307},
                                  ColorRange{-kLargest, kLargest}}) {
    spec.caps = ClipCaps{.map = ColorMap::kGrey, .range = range};
    const ColorRange scaled = *InStoredValues(spec, 256, {}).caps->range;
    EXPECT_LT(scaled.min, scaled.max);
    EXPECT_GE(scaled.min, -kLargest);
    EXPECT_LE(scaled.max, kLargest);
  }
}

}  // namespace
}  // namespace isoscope::frame
