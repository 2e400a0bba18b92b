#include "core/picture/visible_values.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>

#include "gtest/gtest.h"

#include "core/image/normal_and_step.h"
#include "core/image/normal_code.h"
#include "core/picture/color_map.h"
#include "core/view/unprojection.h"
#include "tests/support/status_matchers.h"

namespace isoscope::picture {
namespace {

using frame::ColorBy;
using frame::ColorRange;
using image::Rgba8;

constexpr image::FragmentOrder kOrder{.block_count = 10};
constexpr view::Viewport kViewport{64, 48};

std::uint64_t Key(float depth, std::uint32_t surface) {
  return image::FragmentKey(depth, kOrder.OwnerOf(surface, 3));
}

// Surface 0 shows a field from 0 to 256, 1 is translucent and shows it too, 2 shows x, 3 is plain.
// Caps show samples from -1 to 1.
class VisibleValuesTest : public ::testing::Test {
 protected:
  VisibleValuesTest() {
    const ColorBy by_field{.quantity = ColorBy::Quantity::kField, .range = ColorRange{0, 256}};
    spec_.surfaces = {{.color_by = by_field},
                      {.color_by = by_field, .opacity = 0.5F},
                      {.color_by = ColorBy{}},
                      {}};
    spec_.max_layers = 2;
    spec_.caps = frame::ClipCaps{.map = frame::ColorMap::kGrey, .range = ColorRange{-1, 1}};
    spec_.sends_normals = spec_.sends_map_steps = true;
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

  VisibleValues Find() {
    VisibleValues values(spec_);
    values.Add({.order = kOrder, .image = &image_, .layers = &layers_, .view = &*view_});
    return values;
  }

  frame::FrameSpec spec_;
  std::optional<view::View> view_;
  std::shared_ptr<image::FrameImagePool> images_ = image::FrameImagePool::Make(1 << 20);
  image::FrameImage image_{kViewport.width_px, kViewport.height_px};
  image::LayerStack layers_{kViewport.width_px, kViewport.height_px, 3, kOrder, images_.get()};
};

TEST_F(VisibleValuesTest, AnEmptyPictureShowsNothing) {
  image_.CoverAll();
  for (std::size_t i = 0; i < spec_.surfaces.size(); ++i) {
    EXPECT_FALSE(Find().OfSurface(i).has_value());
  }
  EXPECT_FALSE(Find().OfCaps().has_value());
}

TEST_F(VisibleValuesTest, AStepStandsForItsPartOfTheRange) {
  image_.Set(5, 6, Key(0.5F, 0), Step(7));
  EXPECT_EQ(Find().OfSurface(0), (VisibleSpan{.range = {7, 8}, .is_fine = false}));
  image_.Set(63, 47, Key(0.5F, 0), Step(9));
  EXPECT_EQ(Find().OfSurface(0), (VisibleSpan{.range = {7, 10}, .is_fine = false}));
  image_.Set(0, 0, Key(0.5F, 0), Step(255));
  EXPECT_EQ(Find().OfSurface(0), (VisibleSpan{.range = {7, 256}, .is_fine = true}));
  EXPECT_FALSE(Find().OfSurface(1).has_value());
}

TEST_F(VisibleValuesTest, MissingValuesAndPlainSurfacesDoNotCount) {
  image_.Set(5, 6, Key(0.5F, 0), image::EncodeNormalWithoutStep(image::EncodeNormal({0, 0, 1})));
  image_.Set(6, 6, Key(0.5F, 3), Step(200));
  image_.Set(7, 6, Key(0.5F, 4), kNoSample);
  for (std::size_t i = 0; i < spec_.surfaces.size(); ++i) {
    EXPECT_FALSE(Find().OfSurface(i).has_value());
  }
  EXPECT_FALSE(Find().OfCaps().has_value());
}

TEST_F(VisibleValuesTest, CapsWithSamplesHaveTheGreyOfTheirStep) {
  // Owners of such caps follow those of all surfaces: this is a cap of surface 3.
  image_.Set(7, 6, Key(0.5F, 7), Rgba8{0, 0, 0, 255});
  image_.Set(8, 6, Key(0.5F, 4), Rgba8{127, 127, 127, 255});
  EXPECT_EQ(Find().OfCaps(), (VisibleSpan{.range = {-1, 0}, .is_fine = true}));
  EXPECT_FALSE(Find().OfSurface(0).has_value());
}

TEST_F(VisibleValuesTest, PositionsAreThoseOfThePositionPlane) {
  image_.Set(3, 4, Key(0.25F, 2), image::EncodeNormal({0, 1, 0}));
  image_.Set(60, 40, Key(0.5F, 2), image::EncodeNormal({0, 1, 0}));
  const view::Unprojection unprojection(*view_);
  const double left = unprojection.CoordinateOf(0, 3, 4, unprojection.DistanceOf(0.25F));
  const double right = unprojection.CoordinateOf(0, 60, 40, unprojection.DistanceOf(0.5F));
  ASSERT_LT(left, right);
  EXPECT_EQ(Find().OfSurface(2), (VisibleSpan{.range = {left, right}, .is_fine = true}));
}

TEST_F(VisibleValuesTest, HiddenFragmentsDoNotCountAndTranslucentOnesDo) {
  image_.Set(5, 6, Key(0.5F, 3), image::EncodeNormal({0, 1, 0}));
  layers_.Insert(5, 6, Key(0.7F, 1), Step(10));
  EXPECT_FALSE(Find().OfSurface(1).has_value()) << "behind an opaque fragment";
  layers_.Insert(5, 6, Key(0.1F, 1), Step(20));
  layers_.Insert(5, 6, Key(0.2F, 1), Step(22));
  layers_.Insert(5, 6, Key(0.3F, 1), Step(90));
  EXPECT_EQ(Find().OfSurface(1), (VisibleSpan{.range = {20, 23}, .is_fine = false}))
      << "two layers show";
  // The opacities of the map follow from its range, which is what is looked for.
  spec_.surfaces[1].color_by->opacity_at_min = 0;
  EXPECT_EQ(Find().OfSurface(1), (VisibleSpan{.range = {20, 23}, .is_fine = false}));
}

TEST_F(VisibleValuesTest, WindowsAddUpInAnyOrder) {
  image_.Set(5, 6, Key(0.5F, 0), Step(7));
  image::FrameImage other(kViewport.width_px, kViewport.height_px);
  other.Set(9, 9, Key(0.5F, 0), Step(11));
  for (const bool is_first : {true, false}) {
    VisibleValues values(spec_);
    for (const image::FrameImage* image :
         {is_first ? &image_ : &other, is_first ? &other : &image_}) {
      values.Add({.order = kOrder, .image = image, .layers = &layers_, .view = &*view_});
    }
    EXPECT_EQ(values.OfSurface(0), (VisibleSpan{.range = {7, 12}, .is_fine = false}));
  }
}

}  // namespace
}  // namespace isoscope::picture
