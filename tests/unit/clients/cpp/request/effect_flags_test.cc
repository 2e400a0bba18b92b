#include "clients/cpp/request/effect_flags.h"

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "google/protobuf/descriptor.h"
#include "gtest/gtest.h"

#include "core/base/status_macros.h"
#include "core/frame/picture_effects.h"
#include "isoscope/v1/options.pb.h"
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
    EXPECT_THAT(TryParse({absl::StrCat("--ambient-occlusion=", text)}),
                StatusIs(absl::StatusCode::kInvalidArgument))
        << text;
  }
  EXPECT_THAT(TryParse({"--ambient-occlusion=32,1.5"}),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       HasSubstr("'32,1.5' has the strength 1.5: must be in [0, 1]")));
  for (const char* text : {"0", "17", "x", "2:", "2:1,1", "2:1,1,1,1", ":1,1,1", "2:2,0,0"}) {
    EXPECT_THAT(TryParse({absl::StrCat("--silhouette=", text)}),
                StatusIs(absl::StatusCode::kInvalidArgument))
        << text;
  }
  for (const char* text : {"0", "2", "3", "25", "-4", "4x"}) {
    EXPECT_THAT(TryParse({"--samples", text}), StatusIs(absl::StatusCode::kInvalidArgument))
        << text;
  }
}

TEST(EffectFlagsTest, HelpSaysTheValuesTheirLimitsAndTheirDefaults) {
  cli::FlagSet set({.has_help = false});
  EffectFlags flags;
  AddEffectFlags(&set, &flags);
  const std::vector<cli::FlagDescription> described = set.Describe();
  ASSERT_EQ(described.size(), 3U);
  EXPECT_EQ(described[1].value_name, "[RADIUS[,STRENGTH]]");
  EXPECT_EQ(described[1].help,
            "darken what lies in hollows: how far to look, 4 to 56 pixels (default: 32), and how "
            "much, 0 to 1 (default: 1)");
  EXPECT_EQ(described[2].value_name, "[WIDTH[:COLOR]]");
  EXPECT_EQ(described[2].help,
            "draw lines where surfaces end: 1 to 16 pixels wide (default: 2), and their colour, as "
            "of --color (default: black)");
}

// The options tell people what wire/frame_convert checks, and what frame::PictureEffects begins with.
TEST(EffectFlagsTest, LimitsAndDefaultsAreThoseOfTheServer) {
  const auto options = [](const google::protobuf::Descriptor* effect, const char* name) {
    return effect->FindFieldByName(name)->options().GetExtension(isoscope::v1::value_options);
  };
  const auto radius = options(isoscope::v1::AmbientOcclusion::descriptor(), "radius_px");
  EXPECT_EQ(radius.min(), frame::AmbientOcclusion::kMinRadiusPx);
  EXPECT_EQ(radius.max(), frame::AmbientOcclusion::kMaxRadiusPx);
  EXPECT_EQ(radius.default_text(), absl::StrCat(frame::AmbientOcclusion().radius_px));
  const auto strength = options(isoscope::v1::AmbientOcclusion::descriptor(), "strength");
  EXPECT_EQ(strength.default_text(), absl::StrCat(frame::AmbientOcclusion().strength));
  const auto width = options(isoscope::v1::Silhouette::descriptor(), "width_px");
  EXPECT_EQ(width.min(), 1);
  EXPECT_EQ(width.max(), frame::Silhouette::kMaxWidthPx);
  EXPECT_EQ(width.default_text(), absl::StrCat(frame::Silhouette().width_px));
}

TEST(EffectFlagsTest, SamplesDecideWhatIsDrawnAndHowLargeARegionMayBe) {
  EXPECT_EQ(Parse({}).drawn_size({100, 50}), (view::Viewport{100, 50}));
  EXPECT_EQ(Parse({"--samples", "9"}).drawn_size({100, 50}), (view::Viewport{300, 150}));
  EXPECT_EQ(Parse({"--samples", "16"}).max_region_side_px(), 4096 - 128);
}

}  // namespace
}  // namespace isoscope::client
