#include "clients/cpp/connection/annotated_picture.h"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "google/protobuf/text_format.h"
#include "gtest/gtest.h"

#include "core/base/sha256.h"
#include "core/image/png_codec.h"
#include "tests/support/status_matchers.h"

namespace isoscope::client {
namespace {

namespace v1 = isoscope::v1;

constexpr int kWidth = 320;
constexpr int kHeight = 240;

template <typename Message>
Message FromText(const std::string& text) {
  Message message;
  EXPECT_TRUE(google::protobuf::TextFormat::ParseFromString(text, &message)) << text;
  return message;
}

v1::RenderIsosurfaceRequest PlainRequest() {
  return FromText<v1::RenderIsosurfaceRequest>(
      "dataset: \"d\" isovalue: 60 viewport { width_px: 320 height_px: 240 } "
      "camera_fit: CAMERA_FIT_SURFACE");
}

v1::RenderIsosurfaceResponse PlainAnswer() {
  auto response = FromText<v1::RenderIsosurfaceResponse>(
      "camera { eye { z: 9 } target { } up { y: 1 } perspective { fov_y_degrees: 30 } }");
  response.set_png(
      image::EncodePng(kWidth, kHeight, std::vector<image::Rgba8>(std::size_t{kWidth} * kHeight)));
  return response;
}

// Every pixel that differs lies in a box: `render --like` compares the others.
TEST(AnnotatedPictureTest, OnlyPixelsInTheBoxesChange) {
  const v1::RenderIsosurfaceResponse response = PlainAnswer();
  std::string png = response.png();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const AnnotatedPicture annotated,
      AnnotatePng({.has_axes = true, .has_scale_bar = true, .caption = "at {isovalue}"},
                  PlainRequest(), response, v1::Dataset(), &png));
  EXPECT_EQ(annotated.plain_png_sha256, base::Sha256Hex(response.png()));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::RgbaImage before, image::DecodePng(response.png()));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::RgbaImage after, image::DecodePng(png));
  int changed = 0;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const std::size_t i = static_cast<std::size_t>(y) * kWidth + static_cast<std::size_t>(x);
      if (before.pixels[i] == after.pixels[i]) {
        continue;
      }
      ++changed;
      bool is_inside = false;
      for (const view::PixelRect& box : annotated.boxes) {
        is_inside =
            is_inside || (x >= box.begin_x && x < box.end_x && y >= box.begin_y && y < box.end_y);
      }
      ASSERT_TRUE(is_inside) << x << " " << y;
    }
  }
  EXPECT_GT(changed, 100);
}

TEST(AnnotatedPictureTest, TheRecordHasTheCameraThatWasUsedAndNoFit) {
  const v1::RenderIsosurfaceResponse response = PlainAnswer();
  v1::Dataset dataset;
  dataset.set_samples_digest("abcd");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::string png,
      RecordPng(response.png(), PlainRequest(), response, dataset, "5 cpu", std::nullopt));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RecordedPng recorded, SplitRecordedPng(png));
  EXPECT_EQ(recorded.plain_png, response.png());
  EXPECT_EQ(recorded.record.picture_revision, "5 cpu");
  EXPECT_EQ(recorded.record.samples_digest, "abcd");
  EXPECT_EQ(recorded.record.request.camera_fit(), v1::CAMERA_FIT_UNSPECIFIED);
  EXPECT_EQ(recorded.record.request.camera().eye().z(), 9);
}

TEST(AnnotatedPictureTest, ALegendOfNoColoursIsAnError) {
  std::string png = PlainAnswer().png();
  EXPECT_THAT(AnnotatePng({.has_legend = true}, PlainRequest(), PlainAnswer(), v1::Dataset(), &png),
              testing::StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST(AnnotatedPictureTest, AnAnswerThatIsNoPictureIsAnError) {
  std::string png = "no PNG";
  EXPECT_FALSE(
      AnnotatePng({.has_axes = true}, PlainRequest(), PlainAnswer(), v1::Dataset(), &png).ok());
}

// The server chose the level; the record names it, so that the picture can be made again.
TEST(AnnotatedPictureTest, TheRecordNamesTheLevelThatWasDrawn) {
  v1::RenderIsosurfaceRequest request = PlainRequest();
  request.mutable_level()->set_max_spacing_px(1.1);
  v1::RenderIsosurfaceResponse response = PlainAnswer();
  for (const std::int32_t level : {0, 2}) {
    response.mutable_drawn_level()->set_level(level);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const std::string png,
        RecordPng(response.png(), request, response, v1::Dataset(), "5 cpu", std::nullopt));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RecordedPng recorded, SplitRecordedPng(png));
    // Level 0 is what a request without a choice means, also for older programs.
    EXPECT_EQ(recorded.record.request.has_level(), level > 0);
    EXPECT_EQ(recorded.record.request.level().level(), level);
    EXPECT_EQ(recorded.record.drawn_level.has_value(), level > 0);
  }
}

}  // namespace
}  // namespace isoscope::client
