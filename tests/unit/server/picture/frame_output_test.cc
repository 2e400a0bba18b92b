#include "server/picture/frame_output.h"

#include <cmath>

#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/image/normal_code.h"
#include "core/image/png_codec.h"
#include "core/view/unprojection.h"
#include "tests/support/status_matchers.h"

namespace isoscope::server {
namespace {

constexpr int kWidth = 40;
constexpr int kHeight = 30;
constexpr image::FragmentOrder kOrder{.block_count = 100};

view::View MakeView() {
  volume::GridGeometry geometry;
  geometry.sample_dims = {20, 20, 20};
  auto view =
      view::View::Make(view::MakeDefaultCamera(geometry.Bounds()), {kWidth, kHeight}, geometry);
  ISOSCOPE_EXPECT_OK(view);
  return *view;
}

// Background but for two pixels: surface 0 at (3, 2), surface 2 at (39, 29).
image::FrameImage MakeImage() {
  image::FrameImage image(kWidth, kHeight);
  image.Set(3, 2, image::FragmentKey(0.25F, kOrder.OwnerOf(0, 17)), {10, 20, 30, 255});
  image.Set(39, 29, image::FragmentKey(1.0F, kOrder.OwnerOf(2, 99)), {40, 50, 60, 255});
  return image;
}

float FloatAt(const std::string& plane, std::size_t index) {
  return base::LoadLittleEndian<float>(plane.data() + index * sizeof(float));
}

TEST(FrameOutputTest, PlanesHoldDepthSurfaceAndPositionAndMarkTheBackground) {
  const view::View view = MakeView();
  const image::FrameImage image = MakeImage();
  frame::FrameSpec spec;
  spec.output = {.depth = true, .surface_index = true, .position = true};
  FrameOutput output;
  FillPlanes(image, spec, view, kOrder, &output);
  ASSERT_EQ(output.depth.size(), std::size_t{4} * kWidth * kHeight);
  ASSERT_EQ(output.surface_index.size(), std::size_t{1} * kWidth * kHeight);
  ASSERT_EQ(output.position.size(), std::size_t{12} * kWidth * kHeight);
  const view::Unprojection unprojection(view);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const std::size_t i = image.IndexOf(x, y);
      const auto surface = static_cast<unsigned char>(output.surface_index[i]);
      if ((x == 3 && y == 2) || (x == 39 && y == 29)) {
        const float distance = unprojection.DistanceOf(x == 3 ? 0.25F : 1.0F);
        EXPECT_EQ(FloatAt(output.depth, i), distance);
        EXPECT_EQ(surface, x == 3 ? 0 : 2) << "a fragment of depth 1 is no background";
        EXPECT_EQ(FloatAt(output.position, 3 * i),
                  static_cast<float>(unprojection.PositionOf(x, y, distance).x));
        EXPECT_EQ(FloatAt(output.position, 3 * i + 2),
                  static_cast<float>(unprojection.PositionOf(x, y, distance).z));
      } else {
        ASSERT_EQ(FloatAt(output.depth, i), INFINITY);
        ASSERT_EQ(surface, kBackgroundSurface);
        ASSERT_TRUE(std::isnan(FloatAt(output.position, 3 * i + 1)));
      }
    }
  }
}

TEST(FrameOutputTest, BoundsAreDistancesOrInfinite) {
  const view::View view = MakeView();
  const view::Unprojection unprojection(view);
  visibility::DepthBounds rows(2, 2);
  rows.AddToRows({1, 0, 2, 1}, 0.25F, 0.75F, 0, 2);
  rows.AddToRows({0, 1, 1, 2}, 0, 1, 0, 2);
  std::string plane = "before";
  AppendBounds(rows, view, &plane);
  ASSERT_EQ(plane.size(), 6 + std::size_t{2} * 2 * frame::kDepthBoundsBytes);
  EXPECT_EQ(plane.substr(0, 6), "before") << "rows are appended";
  plane = plane.substr(6);
  for (const std::size_t i : {0U, 1U, 6U, 7U}) {
    EXPECT_EQ(FloatAt(plane, i), INFINITY) << "proved background";
  }
  // The values that the depth plane has for these depths, bit by bit.
  EXPECT_EQ(FloatAt(plane, 2), unprojection.DistanceOf(0.25F));
  EXPECT_EQ(FloatAt(plane, 3), unprojection.DistanceOf(0.75F));
  EXPECT_EQ(FloatAt(plane, 4), unprojection.DistanceOf(0));
  EXPECT_EQ(FloatAt(plane, 5), unprojection.DistanceOf(1));
}

TEST(FrameOutputTest, APointHasTheValuesOfThePlanes) {
  const view::View view = MakeView();
  image::FrameImage image = MakeImage();
  image.colors[image.IndexOf(3, 2)] = image::EncodeNormal({0, 0, -2});
  image.colors[image.IndexOf(39, 29)] = image::kNoNormal;
  const auto point = PointAt(image, 3, 2, view, kOrder, /*carries_normals=*/true);
  ASSERT_TRUE(point.has_value());
  EXPECT_EQ(point->block_id, 17U);
  EXPECT_EQ(point->surface_index, 0U);
  EXPECT_EQ(point->normal, (math::Vec3d{0, 0, -1}));
  const auto last = PointAt(image, 39, 29, view, kOrder, /*carries_normals=*/true);
  ASSERT_TRUE(last.has_value());
  EXPECT_EQ(last->block_id, 99U);
  EXPECT_EQ(last->surface_index, 2U);
  EXPECT_FALSE(last->normal.has_value());
  EXPECT_FALSE(PointAt(image, 0, 0, view, kOrder, true).has_value());
  EXPECT_FALSE(PointAt(image, 3, 2, view, kOrder, false)->normal.has_value());
}

TEST(FrameOutputTest, NormalsAreUnitVectorsAndNanBehind) {
  image::FrameImage image = MakeImage();
  image.colors[image.IndexOf(3, 2)] = image::EncodeNormal({3, 0, 4});
  image.colors[image.IndexOf(39, 29)] = image::kNoNormal;
  const std::string plane = NormalPlane(image);
  const std::size_t i = image.IndexOf(3, 2);
  EXPECT_NEAR(FloatAt(plane, 3 * i), 0.6F, 1e-4F);
  EXPECT_NEAR(FloatAt(plane, 3 * i + 2), 0.8F, 1e-4F);
  EXPECT_EQ(FloatAt(plane, 3 * image.IndexOf(39, 29)), 0.0F);
  EXPECT_TRUE(std::isnan(FloatAt(plane, 0)));
}

TEST(FrameOutputTest, EachFormatShowsTheBackground) {
  const image::FrameImage image = MakeImage();
  frame::FrameSpec spec;
  spec.background_color = {1, 2, 3, 255};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string png, EncodePicture(image, spec));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::RgbaImage decoded, image::DecodePng(png));
  spec.output.image_format = frame::ImageFormat::kRgba8;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string raw, EncodePicture(image, spec));
  ASSERT_EQ(raw.size(), decoded.pixels.size() * sizeof(image::Rgba8));
  EXPECT_EQ(std::memcmp(raw.data(), decoded.pixels.data(), raw.size()), 0);
  EXPECT_EQ(decoded.pixels[0], (image::Rgba8{1, 2, 3, 255}));
  spec.output.image_format = frame::ImageFormat::kJpeg;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string jpeg, EncodePicture(image, spec));
  EXPECT_EQ(jpeg.substr(0, 2), "\xff\xd8");
  spec.output.image_format = frame::ImageFormat::kNone;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string none, EncodePicture(image, spec));
  EXPECT_EQ(none, "");
}

}  // namespace
}  // namespace isoscope::server
