#include "clients/cpp/request/effect_flags.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/status_macros.h"
#include "tests/support/status_matchers.h"

namespace isoscope::client {
namespace {

using isoscope::testing::StatusIs;
using ::testing::HasSubstr;

absl::StatusOr<EffectFlags> TryParse(const std::vector<std::string>& arguments) {
  cli::FlagSet set;
  EffectFlags flags;
  bool has_other_flag = false;
  AddEffectFlags(&set, &flags);
  set.AddSwitch("--other", &has_other_flag, "");
  ISOSCOPE_RETURN_IF_ERROR(set.Parse(arguments));
  return flags;
}

EffectFlags Parse(const std::vector<std::string>& arguments) {
  const absl::StatusOr<EffectFlags> flags = TryParse(arguments);
  ISOSCOPE_EXPECT_OK(flags);
  return flags.value_or(EffectFlags());
}

TEST(EffectFlagsTest, WithoutFlagsTheRequestStaysAsItWas) {
  isoscope::v1::RenderIsosurfaceRequest request;
  SetEffects(Parse({}), &request);
  EXPECT_EQ(request.ByteSizeLong(), 0U);
}

TEST(EffectFlagsTest, AFlagWithoutValueAsksForTheDefaults) {
  for (const std::vector<std::string>& arguments :
       std::vector<std::vector<std::string>>{{"--ambient-occlusion", "--silhouette"},
                                             {"--silhouette", "--other", "--ambient-occlusion"}}) {
    isoscope::v1::RenderIsosurfaceRequest request;
    SetEffects(Parse(arguments), &request);
    EXPECT_TRUE(request.has_ambient_occlusion());
    EXPECT_EQ(request.ambient_occlusion().ByteSizeLong(), 0U);
    EXPECT_TRUE(request.has_silhouette());
    EXPECT_EQ(request.silhouette().ByteSizeLong(), 0U);
  }
}

TEST(EffectFlagsTest, ValuesArrive) {
  isoscope::v1::RenderIsosurfaceRequest request;
  SetEffects(
      Parse({"--samples", "9", "--ambient-occlusion", "12,0.25", "--silhouette", "3:1,0.5,0"}),
      &request);
  EXPECT_EQ(request.samples(), 9);
  EXPECT_EQ(request.ambient_occlusion().radius_px(), 12);
  EXPECT_EQ(request.ambient_occlusion().strength(), 0.25F);
  EXPECT_EQ(request.silhouette().width_px(), 3);
  EXPECT_EQ(request.silhouette().color().red(), 1);
  EXPECT_EQ(request.silhouette().color().green(), 0.5F);
  EXPECT_EQ(request.silhouette().color().alpha(), 1);
  request.Clear();
  SetEffects(Parse({"--ambient-occlusion=8", "--silhouette=16"}), &request);
  EXPECT_EQ(request.ambient_occlusion().radius_px(), 8);
  EXPECT_FALSE(request.ambient_occlusion().has_strength());
  EXPECT_EQ(request.silhouette().width_px(), 16);
  EXPECT_FALSE(request.silhouette().has_color());
}

TEST(EffectFlagsTest, WrongValuesAreNamedWithWhatIsAllowed) {
  for (const char* text : {"3", "57", "x", "32,", "32,1.5", "32,-1", "32,1,1", ",1", "nan"}) {
    EXPECT_THAT(ParseAmbientOcclusion(text), StatusIs(absl::StatusCode::kInvalidArgument)) << text;
  }
  EXPECT_THAT(ParseAmbientOcclusion("32,1.5"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("strength 1.5")));
  for (const char* text : {"0", "17", "x", "2:", "2:1,1", "2:1,1,1,1", ":1,1,1", "2:2,0,0"}) {
    EXPECT_THAT(ParseSilhouette(text), StatusIs(absl::StatusCode::kInvalidArgument)) << text;
  }
  for (const char* text : {"0", "2", "3", "25", "-4", "4x"}) {
    EXPECT_THAT(TryParse({"--samples", text}), StatusIs(absl::StatusCode::kInvalidArgument))
        << text;
  }
}

TEST(EffectFlagsTest, SamplesDecideWhatIsDrawnAndHowLargeARegionMayBe) {
  EXPECT_EQ(Parse({}).drawn_size({100, 50}), (view::Viewport{100, 50}));
  EXPECT_EQ(Parse({"--samples", "9"}).drawn_size({100, 50}), (view::Viewport{300, 150}));
  EXPECT_EQ(Parse({"--samples", "16"}).max_region_side_px(), 4096 - 128);
}

}  // namespace
}  // namespace isoscope::client
