#include "core/frame/picture_effects.h"

#include "gtest/gtest.h"

namespace isoscope::frame {
namespace {

TEST(PictureEffectsTest, NoEffectLooksFartherThanTheLargestMargin) {
  PictureEffects effects;
  EXPECT_EQ(effects.margin_px(), 0);
  effects.silhouette = {.width_px = Silhouette::kMaxWidthPx, .color = {}};
  EXPECT_LE(effects.margin_px(), kMaxMarginPx);
  effects.ambient_occlusion = {.radius_px = AmbientOcclusion::kMaxRadiusPx, .strength = 1};
  EXPECT_EQ(effects.margin_px(), kMaxMarginPx);
}

TEST(PictureEffectsTest, LengthsOfASmallerPictureAreSmallerButLegal) {
  const PictureEffects none{.samples_per_side = 3};
  EXPECT_EQ(none.Scaled(0.25), none);
  PictureEffects effects = none;
  effects.ambient_occlusion = {.radius_px = 32, .strength = 0.5F};
  effects.silhouette = {.width_px = 4, .color = {1, 2, 3, 255}};
  PictureEffects half = effects;
  half.ambient_occlusion->radius_px = 16;
  half.silhouette->width_px = 2;
  EXPECT_EQ(effects.Scaled(0.5), half);
  const PictureEffects least = effects.Scaled(0.01);
  EXPECT_EQ(least.ambient_occlusion->radius_px, AmbientOcclusion::kMinRadiusPx);
  EXPECT_EQ(least.silhouette->width_px, 1);
}

}  // namespace
}  // namespace isoscope::frame
