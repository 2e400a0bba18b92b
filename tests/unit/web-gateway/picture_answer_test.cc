// How a picture may be cached is tested through the Api; here are the requests that can be answered
// and the answers.

#include "web-gateway/picture_answer.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "google/protobuf/text_format.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::gateway {
namespace {

namespace v1 = isoscope::v1;
using ::isoscope::testing::StatusIs;
using ::testing::StartsWith;

template <typename Message>
Message Parse(const std::string& text) {
  Message message;
  EXPECT_TRUE(google::protobuf::TextFormat::ParseFromString(text, &message)) << text;
  return message;
}

TEST(PictureAnswerTest, AnAnswerIsOnePictureOrOnePlane) {
  struct Case {
    std::string request;
    std::string error;  // its begin; "": none
  };
  const std::vector<Case> cases = {
      {"", ""},
      {"output { image_format: IMAGE_FORMAT_JPEG }", ""},
      {"output { image_format: IMAGE_FORMAT_NONE depth: true }", ""},
      {"output { image_format: IMAGE_FORMAT_NONE surface_index: true }", ""},
      {"output { image_format: IMAGE_FORMAT_NONE position: true }", ""},
      {"output { image_format: IMAGE_FORMAT_NONE normal: true }", ""},
      {"output { image_format: IMAGE_FORMAT_NONE }", "output asks for 0 planes"},
      {"output { depth: true }", "output asks for a picture and 1 planes"},
      {"output { image_format: IMAGE_FORMAT_NONE depth: true normal: true }",
       "output asks for 2 planes"},
      {"with_trace: true", "withTrace is true"},
      {"allow_partial: true", "allowPartial is true"},
      {"allow_partial: true output { depth: true }", "output asks for"},
  };
  for (const Case& c : cases) {
    const absl::Status status = CheckAnswerable(Parse<v1::RenderIsosurfaceRequest>(c.request));
    EXPECT_EQ(status.ok(), c.error.empty()) << c.request << ": " << status;
    if (!c.error.empty()) {
      EXPECT_THAT(status, StatusIs(absl::StatusCode::kInvalidArgument, StartsWith(c.error)));
    }
  }
}

TEST(PictureAnswerTest, TheAnswerHasTheOutputThatWasAskedFor) {
  const auto rendered = Parse<v1::RenderIsosurfaceResponse>(
      R"(png: "a" jpeg: "b" rgba8: "c" depth: "d" surface_index: "e" position: "f" normal: "g"
         extent { width_px: 7 height_px: 5 })");
  const std::string bytes = "application/octet-stream";
  struct Case {
    std::string output;
    std::string type;
    std::string body;
  };
  for (const Case& c : std::vector<Case>{
           {"", "image/png", "a"},
           {"image_format: IMAGE_FORMAT_PNG", "image/png", "a"},
           {"image_format: IMAGE_FORMAT_JPEG", "image/jpeg", "b"},
           {"image_format: IMAGE_FORMAT_RGBA8", bytes, "c"},
           {"image_format: IMAGE_FORMAT_NONE depth: true", bytes, "d"},
           {"image_format: IMAGE_FORMAT_NONE surface_index: true", bytes, "e"},
           {"image_format: IMAGE_FORMAT_NONE position: true", bytes, "f"},
           {"image_format: IMAGE_FORMAT_NONE normal: true", bytes, "g"},
       }) {
    v1::RenderIsosurfaceRequest request;
    *request.mutable_output() = Parse<v1::OutputOptions>(c.output);
    const HttpResponse response = PictureResponse(request, {{"ETag", "x"}}, rendered);
    EXPECT_EQ(response.content_type, c.type) << c.output;
    EXPECT_EQ(response.body, c.body) << c.output;
    ASSERT_EQ(response.headers.size(), 3U) << "without fields and times, none for those";
    EXPECT_EQ(response.headers[0].second, "x");
    EXPECT_EQ(response.headers[1].second, "7x5");
  }
}

TEST(PictureAnswerTest, AnApproximatePictureIsNotCached) {
  auto request = Parse<v1::RenderIsosurfaceRequest>("culling: CULLING_MASK");
  const PictureCaching caching = CachingOf(v1::Dataset(), "cpu 1", true, false, &request);
  EXPECT_EQ(caching.etag, "");
  EXPECT_EQ(caching.headers,
            (std::vector<std::pair<std::string, std::string>>{{"Cache-Control", "no-store"}}));
}

}  // namespace
}  // namespace isoscope::gateway
