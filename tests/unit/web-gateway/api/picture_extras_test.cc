#include "web-gateway/api/picture_extras.h"

#include <cstddef>
#include <iterator>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "google/protobuf/text_format.h"
#include "gtest/gtest.h"

#include "clients/cpp/connection/png_metadata.h"
#include "core/image/png_codec.h"
#include "tests/support/status_matchers.h"

namespace isoscope::gateway {
namespace {

namespace v1 = isoscope::v1;
using ::isoscope::testing::IsOk;
using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

constexpr char kCamera[] =
    "eye { z: 10 } target { } up { y: 1 } perspective { fov_y_degrees: 30 } ";

v1::RenderIsosurfaceRequest Request(const std::string& more = "") {
  v1::RenderIsosurfaceRequest request;
  EXPECT_TRUE(google::protobuf::TextFormat::ParseFromString(
      "dataset: \"head\" isovalue: 1 viewport { width_px: 256 height_px: 192 } " + more, &request))
      << more;
  return request;
}

// An answer whose picture is black.
v1::RenderIsosurfaceResponse Answer() {
  v1::RenderIsosurfaceResponse response;
  const std::vector<image::Rgba8> pixels(256 * 192, image::Rgba8{0, 0, 0, 255});
  response.set_png(image::EncodePng(256, 192, pixels));
  EXPECT_TRUE(google::protobuf::TextFormat::ParseFromString(kCamera, response.mutable_camera()));
  return response;
}

PictureExtras Axes() { return {.annotations = {.has_axes = true}}; }
PictureExtras Record() { return {.has_record = true}; }
PictureExtras Webp() { return {.is_webp = true}; }

TEST(PictureExtrasTest, WithoutExtrasThereIsNothingToRefuseAndNoKey) {
  EXPECT_THAT(CheckExtras({}, Request("culling: CULLING_MASK"), ""), IsOk());
  EXPECT_EQ(KeyOf({}), "");
  EXPECT_NE(KeyOf(Axes()), "");
}

TEST(PictureExtrasTest, WhatAnAnswerCantHaveIsRefusedBeforeItIsDrawn) {
  const struct {
    PictureExtras extras;
    std::string request;
    std::string revision;
    absl::StatusCode code;
    std::string said;
  } cases[] = {
      {Axes(), "output { image_format: IMAGE_FORMAT_JPEG }", "cpu 1",
       absl::StatusCode::kInvalidArgument, "of a PNG"},
      {Record(), "output { image_format: IMAGE_FORMAT_NONE depth: true }", "cpu 1",
       absl::StatusCode::kInvalidArgument, "of a PNG"},
      {{.annotations = {.has_legend = true}},
       "",
       "cpu 1",
       absl::StatusCode::kInvalidArgument,
       "color-by"},
      {Record(), "culling: CULLING_MASK", "cpu 1", absl::StatusCode::kInvalidArgument, "mask"},
      {Record(), "", "", absl::StatusCode::kFailedPrecondition, "record"},
      {{.has_record = true, .is_webp = true},
       "",
       "cpu 1",
       absl::StatusCode::kInvalidArgument,
       "format=webp"},
  };
  for (const auto& c : cases) {
    EXPECT_THAT(CheckExtras(c.extras, Request(c.request), c.revision),
                StatusIs(c.code, HasSubstr(c.said)))
        << c.request;
  }
  EXPECT_THAT(CheckExtras(Axes(), Request("output { image_format: IMAGE_FORMAT_PNG }"), ""),
              IsOk());
  EXPECT_THAT(
      CheckExtras({.annotations = {.has_legend = true}},
                  Request("surfaces { isovalue: 1 color_by { quantity: QUANTITY_NORMAL } }"), ""),
      IsOk());
}

TEST(PictureExtrasTest, LargePicturesAreNotDrawnOver) {
  v1::RenderIsosurfaceRequest request = Request();
  request.mutable_viewport()->set_width_px(8192);
  request.mutable_viewport()->set_height_px(4096);
  EXPECT_THAT(CheckExtras(Axes(), request, "cpu 1"), IsOk());
  request.mutable_viewport()->set_height_px(4097);
  EXPECT_THAT(CheckExtras(Axes(), request, "cpu 1"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("33562624 pixels")));
  EXPECT_THAT(CheckExtras(Webp(), request, "cpu 1"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("33562624 pixels")));
  EXPECT_THAT(CheckExtras(Record(), request, "cpu 1"), IsOk()) << "a record needs no pixels";
  request.mutable_region()->set_width_px(64);
  request.mutable_region()->set_height_px(64);
  EXPECT_THAT(CheckExtras(Axes(), request, "cpu 1"), IsOk());
}

TEST(PictureExtrasTest, AWebpHasTheSidesOfItsFormat) {
  v1::RenderIsosurfaceRequest request = Request();
  request.mutable_viewport()->set_height_px(16383);
  EXPECT_THAT(CheckExtras(Webp(), request, ""), IsOk());
  request.mutable_viewport()->set_height_px(16384);
  EXPECT_THAT(CheckExtras(Webp(), request, ""),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("256 x 16384")));
}

TEST(PictureExtrasTest, KeysDifferWhereBytesMay) {
  const PictureExtras all[] = {Axes(),
                               Record(),
                               Webp(),
                               {.annotations = {.has_axes = true}, .is_webp = true},
                               {.annotations = {.has_scale_bar = true}},
                               {.annotations = {.has_legend = true}},
                               {.annotations = {.caption = "axes"}},
                               {.annotations = {.caption = "a"}},
                               {.annotations = {.has_axes = true}, .has_record = true}};
  for (std::size_t i = 0; i < std::size(all); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      EXPECT_NE(KeyOf(all[i]), KeyOf(all[j])) << i << " " << j;
    }
  }
}

TEST(PictureExtrasTest, AxesChangePixelsAndTheRecordSaysWhere) {
  const v1::RenderIsosurfaceRequest request = Request();
  v1::Dataset dataset;
  dataset.set_samples_digest("4ea8");
  const v1::RenderIsosurfaceResponse plain = Answer();
  v1::RenderIsosurfaceResponse response = plain;
  PictureExtras extras = Axes();
  extras.has_record = true;
  ISOSCOPE_ASSERT_OK(AddExtras(extras, request, dataset, "cpu 1", &response));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const client::RecordedPng recorded,
                                client::SplitRecordedPng(response.png()));
  EXPECT_EQ(recorded.record.picture_revision, "cpu 1");
  EXPECT_EQ(recorded.record.samples_digest, "4ea8");
  EXPECT_EQ(recorded.record.request.camera().eye().z(), 10) << "the camera that was used";
  ASSERT_TRUE(recorded.record.annotated.has_value());
  EXPECT_FALSE(recorded.record.annotated->boxes.empty());
  EXPECT_NE(recorded.plain_png, plain.png());
}

TEST(PictureExtrasTest, ARecordAloneKeepsTheBytesOfThePicture) {
  const v1::RenderIsosurfaceResponse plain = Answer();
  v1::RenderIsosurfaceResponse response = plain;
  ISOSCOPE_ASSERT_OK(AddExtras(Record(), Request(), v1::Dataset(), "cpu 1", &response));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const client::RecordedPng recorded,
                                client::SplitRecordedPng(response.png()));
  EXPECT_EQ(recorded.plain_png, plain.png());
  EXPECT_FALSE(recorded.record.annotated.has_value());
}

TEST(PictureExtrasTest, ACaptionThatIsNoTextIsAnError) {
  v1::RenderIsosurfaceResponse response = Answer();
  EXPECT_THAT(
      AddExtras({.annotations = {.caption = "\xff"}}, Request(), v1::Dataset(), "cpu 1", &response),
      StatusIs(absl::StatusCode::kInvalidArgument));
}

}  // namespace
}  // namespace isoscope::gateway
