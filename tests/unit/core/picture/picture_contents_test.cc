#include "core/picture/picture_contents.h"

#include <cstdint>
#include <memory>
#include <optional>

#include "gtest/gtest.h"

#include "core/image/normal_and_step.h"
#include "core/image/normal_code.h"
#include "core/picture/color_map.h"
#include "tests/support/status_matchers.h"

namespace isoscope::picture {
namespace {

using frame::ColorBy;
using image::Rgba8;

constexpr image::FragmentOrder kOrder{.block_count = 10};
constexpr view::Viewport kViewport{64, 48};
constexpr view::PixelRect kAll{0, 0, 64, 48};

std::uint64_t Key(float depth, std::uint32_t surface) {
  return image::FragmentKey(depth, kOrder.OwnerOf(surface, 3));
}

// Surface 0 is opaque and shows a field, 1 is translucent and shows it too, 2 is plain.
class PictureContentsTest : public ::testing::Test {
 protected:
  PictureContentsTest() {
    const ColorBy by_field{.quantity = ColorBy::Quantity::kField, .range = frame::ColorRange{0, 1}};
    spec_.surfaces = {{.color_by = by_field}, {.color_by = by_field, .opacity = 0.5F}, {}};
    spec_.max_layers = 2;
    volume::GridGeometry geometry;
    geometry.sample_dims = {20, 20, 20};
    absl::StatusOr<view::View> view =
        view::View::Make(view::MakeDefaultCamera(geometry.Bounds()), kViewport, geometry);
    ISOSCOPE_EXPECT_OK(view);
    view_.emplace(*view);
  }

  static Rgba8 Step(std::uint8_t step) {
    return image::EncodeNormalAndStep(image::EncodeNormal({0, 0, 1}), step);
  }
  static Rgba8 Missing() { return image::EncodeNormalWithoutStep(image::EncodeNormal({0, 0, 1})); }

  PictureContents Find(bool with_shown, const view::PixelRect& window = kAll) {
    const DeferredShader shader(spec_, *view_, kOrder);
    return FindContents({.spec = &spec_,
                         .order = kOrder,
                         .image = &image_,
                         .layers = &layers_,
                         .shader = NeedsDeferredShading(spec_) ? &shader : nullptr},
                        window, with_shown);
  }
  // Both ways of looking agree on missing values.
  PictureContents FindBoth() {
    PictureContents all = Find(true);
    PictureContents missing = Find(false);
    EXPECT_TRUE(missing.shown.none());
    EXPECT_EQ(all.without_values, missing.without_values);
    EXPECT_EQ(all.has_caps_without_samples, missing.has_caps_without_samples);
    return all;
  }

  frame::FrameSpec spec_;
  std::optional<view::View> view_;
  std::shared_ptr<image::FrameImagePool> images_ = image::FrameImagePool::Make(1 << 20);
  image::FrameImage image_{kViewport.width_px, kViewport.height_px};
  image::LayerStack layers_{kViewport.width_px, kViewport.height_px, 3, kOrder, images_.get()};
};

TEST_F(PictureContentsTest, AnEmptyPictureShowsNothing) {
  image_.CoverAll();
  EXPECT_EQ(FindBoth(), PictureContents());
}

TEST_F(PictureContentsTest, EachSurfaceThatHasAPixelShows) {
  image_.Set(63, 47, Key(0.5F, 2), image::EncodeNormal({0, 1, 0}));
  EXPECT_EQ(FindBoth().shown.to_ulong(), 0b100U);
  layers_.Insert(0, 0, Key(0.7F, 1), Step(0));
  EXPECT_EQ(FindBoth().shown.to_ulong(), 0b110U);
  EXPECT_TRUE(FindBoth().without_values.none());
}

TEST_F(PictureContentsTest, AMissingValueIsFoundInTheOpaqueImageAndInLayers) {
  image_.Set(5, 6, Key(0.5F, 0), Step(255));
  EXPECT_TRUE(FindBoth().without_values.none());
  image_.Set(7, 6, Key(0.5F, 0), Missing());
  EXPECT_EQ(FindBoth().without_values.to_ulong(), 0b001U);
  layers_.Insert(40, 40, Key(0.7F, 1), Missing());
  EXPECT_EQ(FindBoth().without_values.to_ulong(), 0b011U);
}

TEST_F(PictureContentsTest, OtherFragmentsMayHaveTheBitsOfAMissingValue) {
  image_.Set(5, 6, Key(0.5F, 2), Missing());
  image_.Set(6, 6, Key(0.5F, 2), kNoSample);
  EXPECT_TRUE(FindBoth().without_values.none());
  EXPECT_FALSE(FindBoth().has_caps_without_samples);
}

TEST_F(PictureContentsTest, BehindOpaqueFragmentsAndTooManyLayersNothingShows) {
  image_.Set(5, 6, Key(0.5F, 2), image::EncodeNormal({0, 1, 0}));
  layers_.Insert(5, 6, Key(0.7F, 1), Missing());
  EXPECT_TRUE(FindBoth().without_values.none());
  EXPECT_EQ(FindBoth().shown.to_ulong(), 0b100U);
  layers_.Insert(8, 8, Key(0.1F, 1), Step(1));
  layers_.Insert(8, 8, Key(0.2F, 1), Step(1));
  layers_.Insert(8, 8, Key(0.3F, 1), Missing());
  EXPECT_TRUE(FindBoth().without_values.none());
  spec_.max_layers = 3;
  EXPECT_EQ(FindBoth().without_values.to_ulong(), 0b010U);
}

TEST_F(PictureContentsTest, FragmentsOfOpacityZeroDoNotShowAndThoseOfOneHide) {
  spec_.surfaces[1].opacity = 1;
  spec_.surfaces[1].color_by->opacity_at_min = 0;
  image_.Set(5, 6, Key(0.9F, 0), Missing());
  layers_.Insert(5, 6, Key(0.7F, 1), Step(0));
  EXPECT_EQ(FindBoth().shown.to_ulong(), 0b001U);
  EXPECT_EQ(FindBoth().without_values.to_ulong(), 0b001U);
  layers_.Insert(5, 6, Key(0.6F, 1), Step(255));
  EXPECT_EQ(FindBoth().shown.to_ulong(), 0b010U);
  EXPECT_TRUE(FindBoth().without_values.none());
  // A missing value has the opacity of the more opaque end.
  layers_.Insert(5, 6, Key(0.5F, 1), Missing());
  EXPECT_EQ(FindBoth().without_values.to_ulong(), 0b010U);
  spec_.surfaces[1].color_by->opacity_at_max = 0;
  EXPECT_EQ(FindBoth().shown.to_ulong(), 0b001U);
}

TEST_F(PictureContentsTest, OnlyTheWindowCounts) {
  image_.Set(10, 20, Key(0.5F, 0), Missing());
  layers_.Insert(11, 20, Key(0.5F, 1), Missing());
  EXPECT_EQ(Find(true, {10, 20, 11, 21}).without_values.to_ulong(), 0b001U);
  EXPECT_EQ(Find(false, {11, 20, 12, 21}).without_values.to_ulong(), 0b010U);
  for (const view::PixelRect& beside :
       {view::PixelRect{0, 0, 10, 48}, {12, 0, 64, 48}, {0, 0, 64, 20}, {0, 21, 64, 48}}) {
    EXPECT_EQ(Find(true, beside), PictureContents());
    EXPECT_EQ(Find(false, beside), PictureContents());
  }
}

TEST_F(PictureContentsTest, ACapWithoutASampleIsOfItsSurface) {
  spec_.caps = frame::ClipCaps{.map = frame::ColorMap::kViridis, .range = frame::ColorRange{0, 1}};
  image_.Set(5, 6, Key(0.5F, 3 + 2), {1, 2, 3, 255});
  EXPECT_EQ(FindBoth().shown.to_ulong(), 0b100U);
  EXPECT_FALSE(FindBoth().has_caps_without_samples);
  image_.Set(7, 6, Key(0.5F, 3 + 2), kNoSample);
  EXPECT_TRUE(FindBoth().has_caps_without_samples);
  EXPECT_TRUE(FindBoth().without_values.none());
}

TEST_F(PictureContentsTest, WithoutNormalsACapWithoutASampleIsColoredHere) {
  spec_.surfaces.assign(1, {});
  image_.Set(4, 6, Key(0.5F, 0), {1, 2, 3, 255});
  image_.Set(5, 6, Key(0.5F, 0), kNoSample);
  image_.CoverAll();
  image::FrameImage before = image_;
  ColorCapsWithoutSamples(spec_, &image_);
  EXPECT_TRUE(image_ == before) << "no caps";
  spec_.caps = frame::ClipCaps{.map = frame::ColorMap::kViridis, .range = frame::ColorRange{0, 1}};
  EXPECT_TRUE(FindBoth().has_caps_without_samples);
  EXPECT_EQ(FindBoth().shown.to_ulong(), 0b1U);
  ColorCapsWithoutSamples(spec_, &image_);
  EXPECT_EQ(image_.colors[image_.IndexOf(4, 6)], (Rgba8{1, 2, 3, 255}));
  EXPECT_EQ(image_.colors[image_.IndexOf(5, 6)], (Rgba8{128, 128, 128, 255}));
  EXPECT_EQ(image_.colors[image_.IndexOf(6, 6)], Rgba8()) << "background stays";
}

}  // namespace
}  // namespace isoscope::picture
