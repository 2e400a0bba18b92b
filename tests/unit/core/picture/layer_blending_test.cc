#include "core/picture/layer_blending.h"

#include <cstdint>

#include "gtest/gtest.h"

#include "core/picture/linear_light.h"

namespace isoscope::picture {
namespace {

using image::Rgba8;

constexpr image::FragmentOrder kOrder{.block_count = 10};
constexpr Rgba8 kRed{255, 0, 0, 255};
constexpr Rgba8 kGreen{0, 255, 0, 255};
constexpr Rgba8 kBlue{0, 0, 255, 255};

std::uint8_t Srgb(float linear) {
  return LinearLight().srgb[static_cast<std::size_t>(linear * kFullLight + 0.5F)];
}

std::uint64_t Key(float depth, std::uint32_t surface) {
  return image::FragmentKey(depth, kOrder.OwnerOf(surface, 3));
}

// Surface 0 is opaque, 1 and 2 let half and three quarters of the light pass.
class LayerBlendingTest : public ::testing::Test {
 protected:
  LayerBlendingTest() {
    spec_.surfaces = {{.rule = {.isovalue = 1}},
                      {.rule = {.isovalue = 2}, .opacity = 0.5F},
                      {.rule = {.isovalue = 3}, .opacity = 0.25F}};
    spec_.max_layers = 2;
    spec_.background_color = {0, 0, 0, 255};
  }
  image::LayerStack Stack() { return {20, 20, spec_.max_layers + 1, kOrder, images_.get()}; }
  Rgba8 At(int x, int y) const { return image_.colors[image_.IndexOf(x, y)]; }

  frame::FrameSpec spec_;
  std::shared_ptr<image::FrameImagePool> images_ = image::FrameImagePool::Make(1 << 20);
  image::FrameImage image_{20, 20};
};

TEST_F(LayerBlendingTest, TwoLayersOverAnOpaqueFragmentMixInLinearLight) {
  image::LayerStack layers = Stack();
  image_.Set(4, 5, Key(0.9F, 0), kBlue);
  layers.Insert(4, 5, Key(0.7F, 2), kGreen);
  layers.Insert(4, 5, Key(0.5F, 1), kRed);
  EXPECT_EQ(BlendLayers(layers, spec_, &image_), 0);
  // 0.5 red, 0.5 * 0.25 green, and blue gets the remaining 0.375.
  EXPECT_EQ(At(4, 5), (Rgba8{Srgb(0.5F), Srgb(0.125F), Srgb(0.375F), 255}));
  EXPECT_EQ(image_.keys[image_.IndexOf(4, 5)], Key(0.9F, 0));
}

TEST_F(LayerBlendingTest, LayersBehindTheOpaqueFragmentDoNotShow) {
  image::LayerStack layers = Stack();
  image_.Set(4, 5, Key(0.5F, 0), kBlue);
  layers.Insert(4, 5, Key(0.7F, 1), kRed);
  // At equal depth the earlier surface shows, and that is the opaque one.
  image_.Set(6, 6, Key(0.5F, 0), kBlue);
  layers.Insert(6, 6, Key(0.5F, 1), kRed);
  EXPECT_EQ(BlendLayers(layers, spec_, &image_), 0);
  EXPECT_EQ(At(4, 5), kBlue);
  EXPECT_EQ(At(6, 6), kBlue);
}

TEST_F(LayerBlendingTest, ALayerOverATransparentBackgroundKeepsItsColorAndGetsItsOpacity) {
  spec_.background_color = {};
  image::LayerStack layers = Stack();
  layers.Insert(0, 0, Key(0.7F, 2), kGreen);
  layers.Insert(19, 19, Key(0.7F, 1), kRed);
  BlendLayers(layers, spec_, &image_);
  EXPECT_EQ(At(0, 0), (Rgba8{0, 255, 0, 64}));
  EXPECT_EQ(At(19, 19), (Rgba8{255, 0, 0, 128}));
  EXPECT_EQ(At(1, 1), Rgba8{});
  // The pool clears what is covered.
  EXPECT_NE(image_.CoveredOf(1, 1)[3] >> 3 & 1, 0);
}

TEST_F(LayerBlendingTest, ATranslucentBackgroundAddsItsShare) {
  spec_.background_color = {0, 0, 255, 51};
  image::LayerStack layers = Stack();
  layers.Insert(3, 3, Key(0.5F, 1), kRed);
  BlendLayers(layers, spec_, &image_);
  // 0.5 red and 0.5 * 0.2 blue: alpha 0.6.
  EXPECT_EQ(At(3, 3), (Rgba8{Srgb(0.5F / 0.6F), 0, Srgb(0.1F / 0.6F), 153}));
}

TEST_F(LayerBlendingTest, OnlyPixelsOfTheRectangleAreCounted) {
  image::LayerStack layers = Stack();
  for (const int x : {2, 7}) {
    for (const float depth : {0.3F, 0.4F, 0.9F}) {
      layers.Insert(x, 1, Key(depth, 1), kRed);
    }
  }
  image::FrameImage image = image_;
  EXPECT_EQ(BlendLayers(layers, spec_, {0, 1, 7, 2}, &image), 1);
  EXPECT_EQ(BlendLayers(layers, spec_, {0, 2, 8, 3}, &image), 0);
  BlendLayers(layers, spec_, &image_);
  EXPECT_EQ(image.colors[image.IndexOf(7, 1)], At(7, 1)) << "they show all the same";
}

TEST_F(LayerBlendingTest, TheNearestLayersShowAndPixelsWithMoreAreCounted) {
  image::LayerStack layers = Stack();
  for (const int x : {2, 7}) {
    layers.Insert(x, 1, Key(0.3F, 1), kRed);
    layers.Insert(x, 1, Key(0.4F, 1), kRed);
  }
  layers.Insert(7, 1, Key(0.9F, 1), kGreen);
  EXPECT_EQ(BlendLayers(layers, spec_, &image_), 1);
  EXPECT_EQ(At(2, 1), At(7, 1));
  EXPECT_EQ(At(2, 1), (Rgba8{Srgb(0.75F), 0, 0, 255}));
}

TEST_F(LayerBlendingTest, ALayerTooManyThatTheOpaqueFragmentHidesIsNotCounted) {
  image::LayerStack layers = Stack();
  image_.Set(7, 1, Key(0.5F, 0), kBlue);
  for (const float depth : {0.3F, 0.4F, 0.9F}) {
    layers.Insert(7, 1, Key(depth, 1), kRed);
  }
  EXPECT_EQ(BlendLayers(layers, spec_, &image_), 0);
}

TEST_F(LayerBlendingTest, OpacitiesOfAMapAreThoseOfTheStepInAlpha) {
  spec_.surfaces[1].color_by = frame::ColorBy{.opacity_at_min = 0, .opacity_at_max = 1};
  spec_.max_layers = 3;
  image::LayerStack layers = Stack();
  const auto red = [](std::uint8_t step) { return Rgba8{255, 0, 0, step}; };
  for (const int x : {0, 1, 2, 3}) {
    image_.Set(x, 0, Key(0.9F, 0), kBlue);
  }
  layers.Insert(0, 0, Key(0.5F, 1), red(255));  // half opaque, by the surface
  layers.Insert(1, 0, Key(0.5F, 1), red(51));   // a fifth of that
  layers.Insert(2, 0, Key(0.5F, 1), red(0));    // nothing
  layers.Insert(3, 0, Key(0.4F, 1), red(0));
  layers.Insert(3, 0, Key(0.5F, 2), kGreen);
  EXPECT_EQ(BlendLayers(layers, spec_, &image_), 0);
  EXPECT_EQ(At(0, 0), (Rgba8{Srgb(0.5F), 0, Srgb(0.5F), 255}));
  EXPECT_EQ(At(1, 0), (Rgba8{Srgb(0.1F), 0, Srgb(0.9F), 255}));
  EXPECT_EQ(At(2, 0), kBlue);
  EXPECT_EQ(At(3, 0), (Rgba8{0, Srgb(0.25F), Srgb(0.75F), 255})) << "as if it were not there";
}

TEST_F(LayerBlendingTest, LayersOfOpacity0LeaveTheBackgroundAndCountAsLayers) {
  spec_.surfaces[1].color_by = frame::ColorBy{.opacity_at_min = 0, .opacity_at_max = 1};
  image::LayerStack layers = Stack();
  for (const float depth : {0.3F, 0.4F, 0.5F}) {
    layers.Insert(4, 4, Key(depth, 1), {9, 9, 9, 0});
  }
  EXPECT_EQ(BlendLayers(layers, spec_, &image_), 1);
  EXPECT_EQ(At(4, 4), Rgba8{}) << "background";
}

TEST_F(LayerBlendingTest, PlanesTellTheNearestFragmentHoweverTranslucent) {
  image::LayerStack layers = Stack();
  image_.Set(4, 5, Key(0.9F, 0), kBlue);
  layers.Insert(4, 5, Key(0.7F, 2), kGreen);
  image_.Set(6, 5, Key(0.1F, 0), kBlue);
  layers.Insert(6, 5, Key(0.7F, 2), kGreen);
  layers.Insert(8, 5, Key(0.7F, 2), kGreen);
  ShowNearest(layers, &image_);
  EXPECT_EQ(image_.keys[image_.IndexOf(4, 5)], Key(0.7F, 2));
  EXPECT_EQ(At(4, 5), kGreen);
  EXPECT_EQ(image_.keys[image_.IndexOf(6, 5)], Key(0.1F, 0));
  EXPECT_EQ(image_.keys[image_.IndexOf(8, 5)], Key(0.7F, 2));
}

TEST_F(LayerBlendingTest, AFrameWithoutLayersDoesNotChange) {
  image_.Set(4, 5, Key(0.9F, 0), kBlue);
  const image::FrameImage before = image_;
  EXPECT_EQ(BlendLayers(image::LayerStack(), spec_, &image_), 0);
  ShowNearest(image::LayerStack(), &image_);
  EXPECT_TRUE(before == image_);
}

}  // namespace
}  // namespace isoscope::picture
