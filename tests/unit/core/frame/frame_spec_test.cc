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

}  // namespace
}  // namespace isoscope::frame
