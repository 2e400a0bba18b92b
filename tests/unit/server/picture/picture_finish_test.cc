#include "server/picture/picture_finish.h"

#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::server {
namespace {

using image::FrameImage;
using image::Rgba8;

constexpr image::FragmentOrder kOrder{.block_count = 100};
constexpr Rgba8 kClay{200, 150, 100, 255};

struct Frame {
  frame::FrameSpec spec;
  frame::DrawnWindow window;
  view::View view;
  FrameImage drawn;
};

// A viewport of 60 x 40 pixels whose left half shows a surface.
Frame MakeFrame(const frame::PictureEffects& effects,
                const std::optional<view::Region>& region = std::nullopt) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {20, 20, 20};
  frame::FrameSpec spec;
  spec.viewport = {60, 40};
  spec.region = region;
  spec.effects = effects;
  spec.camera = view::MakeDefaultCamera(geometry.Bounds());
  const frame::DrawnWindow window = frame::DrawnWindowOf(spec);
  auto view = view::View::Make(*spec.camera, window.viewport, geometry, window.region);
  ISOSCOPE_EXPECT_OK(view);
  FrameImage drawn(view->region().width_px, view->region().height_px);
  for (int y = 0; y < drawn.height; ++y) {
    for (int x = 0; x < drawn.width; ++x) {
      if (view->region().x + x < window.viewport.width_px / 2) {
        drawn.Set(x, y, image::FragmentKey(0.5F, 7), kClay);
      }
    }
  }
  return {std::move(spec), window, *view, std::move(drawn)};
}

FrameImage Finish(const Frame& frame) {
  FrameImage drawn = frame.drawn;
  image::LayerStack no_layers;
  return FinishPicture({.spec = &frame.spec,
                        .window = &frame.window,
                        .drawn_view = &frame.view,
                        .order = kOrder,
                        .layers = &no_layers,
                        .images = image::FrameImagePool::Make(1 << 20).get()},
                       &drawn)
      .image;
}

TEST(PictureFinishTest, WithoutEffectsThePictureIsWhatWasDrawn) {
  const Frame frame = MakeFrame({}, view::Region{3, 4, 50, 30});
  EXPECT_TRUE(Finish(frame) == frame.drawn);
}

TEST(PictureFinishTest, SamplesGiveAPictureOfTheSizeAskedFor) {
  const Frame frame = MakeFrame({.samples_per_side = 3, .ambient_occlusion = {}, .silhouette = {}},
                                view::Region{10, 0, 40, 20});
  ASSERT_EQ(frame.drawn.width, 120);
  const FrameImage picture = Finish(frame);
  ASSERT_EQ(picture.width, 40);
  ASSERT_EQ(picture.height, 20);
  EXPECT_EQ(picture.colors[picture.IndexOf(19, 5)], kClay);
  EXPECT_EQ(picture.colors[picture.IndexOf(20, 5)], Rgba8());
}

TEST(PictureFinishTest, ARegionLosesItsMarginAndKeepsItsDepths) {
  const frame::Silhouette line{.width_px = 2, .color = {0, 0, 255, 255}};
  const Frame frame =
      MakeFrame({.ambient_occlusion = {}, .silhouette = line}, view::Region{20, 10, 20, 8});
  ASSERT_EQ(frame.drawn.width, 28);
  const FrameImage picture = Finish(frame);
  ASSERT_EQ(picture.width, 20);
  ASSERT_EQ(picture.height, 8);
  EXPECT_EQ(picture.colors[picture.IndexOf(7, 0)], kClay);
  EXPECT_EQ(picture.colors[picture.IndexOf(8, 0)], line.color);
  EXPECT_EQ(picture.colors[picture.IndexOf(9, 7)], line.color);
  EXPECT_EQ(picture.colors[picture.IndexOf(10, 0)], Rgba8());
  EXPECT_EQ(picture.keys[picture.IndexOf(9, 7)], image::FragmentKey(0.5F, 7));
  EXPECT_EQ(picture.keys[picture.IndexOf(10, 7)], image::kBackgroundKey);
}

// The order of the stages: a line is as bright as asked for, and its edge is smooth.
TEST(PictureFinishTest, LinesAreNotDarkenedButAveraged) {
  const frame::Silhouette line{.width_px = 1, .color = {255, 255, 255, 255}};
  Frame frame =
      MakeFrame({.samples_per_side = 2,
                 .ambient_occlusion = frame::AmbientOcclusion{.radius_px = 4, .strength = 1},
                 .silhouette = line});
  // A second surface, nearer, ends in the middle of a pixel: at sample 41 of 40 and 41.
  for (int y = 0; y < frame.drawn.height; ++y) {
    for (int x = 0; x < 41; ++x) {
      frame.drawn.Set(x, y, image::FragmentKey(0.25F, 107), kClay);
    }
  }
  const FrameImage picture = Finish(frame);
  // Samples 39 and 40 are the line; pixels 19 and 20 have one of them each.
  EXPECT_EQ(picture.colors[picture.IndexOf(18, 20)], kClay);
  EXPECT_GT(picture.colors[picture.IndexOf(19, 20)].b, kClay.b);
  EXPECT_LT(picture.colors[picture.IndexOf(19, 20)].b, 255);
  EXPECT_EQ(picture.colors[picture.IndexOf(29, 20)], line.color) << "before the background";
}

}  // namespace
}  // namespace isoscope::server
