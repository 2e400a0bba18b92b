// The requests that can be answered, the answers, and how long they may be cached. Fields and steps
// that change what may be cached are tested through the Api.

#include "web-gateway/api/picture_answer.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "google/protobuf/text_format.h"
#include "gtest/gtest.h"

#include "core/image/png_codec.h"
#include "tests/support/status_matchers.h"

namespace isoscope::gateway {
namespace {

namespace v1 = isoscope::v1;
using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;
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
      {"output { image_format: IMAGE_FORMAT_NONE depth_bounds: true }", ""},
      {"output { depth_bounds: true }", "output asks for a picture and 1 planes"},
      {"output { image_format: IMAGE_FORMAT_NONE }", "output asks for 0 planes"},
      {"output { depth: true }", "output asks for a picture and 1 planes"},
      {"output { image_format: IMAGE_FORMAT_NONE depth: true normal: true }",
       "output asks for 2 planes"},
      {"with_trace: true", "withTrace is true"},
      {"allow_partial: true", "allowPartial is true"},
      {"allow_partial: true output { depth: true }", "output asks for"},
      {"with_notes: true", "withNotes is true"},
      {"with_unresolved_count: true", "withUnresolvedCount is true"},
  };
  for (const Case& c : cases) {
    const absl::Status status = CheckAnswerable(Parse<v1::RenderIsosurfaceRequest>(c.request));
    EXPECT_EQ(status.ok(), c.error.empty()) << c.request << ": " << status;
    if (!c.error.empty()) {
      EXPECT_THAT(status, StatusIs(absl::StatusCode::kInvalidArgument, StartsWith(c.error)));
    }
  }
}

TEST(PictureAnswerTest, APngBecomesAWebpOrStaysAsItIs) {
  HttpResponse response;
  response.content_type = "image/png";
  response.body = image::EncodePng(2, 1, std::vector<image::Rgba8>(2));
  ISOSCOPE_ASSERT_OK(ConvertToWebp(&response));
  EXPECT_EQ(response.content_type, "image/webp");
  EXPECT_THAT(response.body, StartsWith("RIFF"));
  response = {.content_type = "image/png", .body = "no PNG"};
  EXPECT_FALSE(ConvertToWebp(&response).ok());
  EXPECT_EQ(response.body, "no PNG");
}

TEST(PictureAnswerTest, TheAnswerHasTheOutputThatWasAskedFor) {
  const auto rendered = Parse<v1::RenderIsosurfaceResponse>(
      R"(png: "a" jpeg: "b" rgba8: "c" depth: "d" surface_index: "e" position: "f" normal: "g" depth_bounds: "h"
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
           {"image_format: IMAGE_FORMAT_NONE depth_bounds: true", bytes, "h"},
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

TEST(PictureAnswerTest, TheAnswerSaysItsFieldsAndItsTime) {
  const auto rendered = Parse<v1::RenderIsosurfaceResponse>(
      R"(png: "a" selection { field: "T" time_step: 3 } time: 1.5)");
  const HttpResponse response = PictureResponse({}, {}, rendered);
  ASSERT_EQ(response.headers.size(), 4U);
  EXPECT_EQ(response.headers[2].first, "X-Isoscope-Selection");
  EXPECT_THAT(response.headers[2].second, HasSubstr(R"("T")"));
  EXPECT_EQ(response.headers[3].first, "X-Isoscope-Time");
  EXPECT_THAT(response.headers[3].second, HasSubstr("1.5"));
}

TEST(PictureAnswerTest, TheAnswerSaysTheRangesOfItsColours) {
  const auto rendered = Parse<v1::RenderIsosurfaceResponse>(
      R"(png: "a"
         colorings { surface_index: 0 color_by { quantity: QUANTITY_NORMAL } }
         colorings { surface_index: 2 color_by { range { min: -0.1 max: 3e22 } } }
         caps_coloring { caps { range { min: 10 max: 110.5 } } })");
  const HttpResponse response = PictureResponse({}, {}, rendered);
  ASSERT_EQ(response.headers.size(), 3U);
  EXPECT_EQ(response.headers[2].first, "X-Isoscope-Color-Ranges");
  EXPECT_EQ(response.headers[2].second, R"({"2":[-0.1,3e+22],"caps":[10.0,110.5]})");
}

TEST(PictureAnswerTest, WhoMayKeepAPictureAndForHowLong) {
  struct Case {
    bool is_by_id;
    bool is_private;
    const char* cache_control;
  };
  for (const Case& c :
       {Case{false, false, "public, no-cache"}, Case{false, true, "private, no-cache"},
        Case{true, false, "public, max-age=31536000, immutable"},
        Case{true, true, "private, max-age=31536000, immutable"}}) {
    v1::RenderIsosurfaceRequest request;
    const PictureCaching caching =
        CachingOf(v1::Dataset(), "cpu 1", c.is_by_id, c.is_private, /*extras_key=*/"", &request);
    ASSERT_EQ(caching.headers.size(), 2U);
    EXPECT_EQ(caching.headers[0].first, "ETag");
    EXPECT_EQ(caching.headers[0].second, caching.etag);
    EXPECT_EQ(caching.headers[1].first, "Cache-Control");
    EXPECT_EQ(caching.headers[1].second, c.cache_control);
  }
}

TEST(PictureAnswerTest, PicturesThatMayDifferHaveTagsThatDiffer) {
  const auto tag_of = [](const char* id, const char* revision, const char* request_text,
                         const char* extras_key = "") {
    auto request = Parse<v1::RenderIsosurfaceRequest>(request_text);
    v1::Dataset dataset;
    dataset.set_dataset_id(id);
    return CachingOf(dataset, revision, true, false, extras_key, &request).etag;
  };
  const std::string tag = tag_of("a", "cpu 1", "isovalue: 1");
  EXPECT_EQ(tag_of("a", "cpu 1", "isovalue: 1"), tag);
  EXPECT_NE(tag_of("b", "cpu 1", "isovalue: 1"), tag);
  EXPECT_NE(tag_of("a", "cpu 2", "isovalue: 1"), tag);
  EXPECT_NE(tag_of("a", "cpu 1", "isovalue: 2"), tag);
  EXPECT_NE(tag_of("a", "cpu 1", "isovalue: 1", "axes"), tag);
  EXPECT_NE(tag_of("a", "cpu 1", "isovalue: 1", "axes"),
            tag_of("a", "cpu 1", "isovalue: 1", "legend"));
}

// Its text shows names and units, which may change, in a font of the gateway's machine.
TEST(PictureAnswerTest, APictureThatTheGatewayDrewOverIsNotImmutable) {
  v1::RenderIsosurfaceRequest request;
  v1::Dataset dataset;
  const PictureCaching caching = CachingOf(dataset, "cpu 1", true, false, "axes", &request);
  EXPECT_EQ(caching.headers[1].second, "public, no-cache");
  dataset.set_length_unit("mm");
  EXPECT_NE(CachingOf(dataset, "cpu 1", true, false, "axes", &request).etag, caching.etag);
}

TEST(PictureAnswerTest, AnApproximatePictureIsNotCached) {
  auto request = Parse<v1::RenderIsosurfaceRequest>("culling: CULLING_MASK");
  const PictureCaching caching =
      CachingOf(v1::Dataset(), "cpu 1", true, false, /*extras_key=*/"", &request);
  EXPECT_EQ(caching.etag, "");
  EXPECT_EQ(caching.headers,
            (std::vector<std::pair<std::string, std::string>>{{"Cache-Control", "no-store"}}));
}

// Nobody knows then whether a later picture has the same pixels.
TEST(PictureAnswerTest, APictureOfUnknownCodeIsNotCached) {
  v1::RenderIsosurfaceRequest request;
  EXPECT_EQ(CachingOf(v1::Dataset(), "", true, false, /*extras_key=*/"", &request).etag, "");
}

TEST(PictureAnswerTest, TheAnswerSaysItsLevel) {
  const auto rendered = Parse<v1::RenderIsosurfaceResponse>(
      R"(png: "a" drawn_level { level: 2 max_spacing_px: 0.5 spacing { x: 4 y: 4 z: 8 } })");
  const HttpResponse response = PictureResponse({}, {}, rendered);
  ASSERT_EQ(response.headers.size(), 3U);
  EXPECT_EQ(response.headers[2].first, "X-Isoscope-Level");
  EXPECT_THAT(response.headers[2].second, HasSubstr("2"));
  EXPECT_THAT(response.headers[2].second, HasSubstr("0.5"));
}

// Levels are added and dropped while the id of the dataset stays.
TEST(PictureAnswerTest, AChoiceOfLevelsIsTaggedByTheLevelsThatThereAre) {
  const auto caching_of = [](const char* request_text, const char* dataset_text) {
    auto request = Parse<v1::RenderIsosurfaceRequest>(request_text);
    return CachingOf(Parse<v1::Dataset>(dataset_text), "cpu 1", true, false, "", &request);
  };
  constexpr char kSome[] = "levels { level: 1 filter: FILTER_MEAN }";
  constexpr char kMore[] =
      "levels { level: 1 filter: FILTER_MEAN } levels { level: 2 filter: FILTER_MEAN }";
  constexpr char kOthers[] = "levels { level: 1 filter: FILTER_MAJORITY }";
  for (const char* request : {"level { max_spacing_px: 1.1 }", "level { level: 1 }"}) {
    const PictureCaching caching = caching_of(request, kSome);
    EXPECT_EQ(caching_of(request, kSome).etag, caching.etag);
    EXPECT_NE(caching_of(request, kMore).etag, caching.etag) << request;
    EXPECT_NE(caching_of(request, kOthers).etag, caching.etag) << request;
    EXPECT_EQ(caching.headers[1].second, "public, no-cache");
  }
  for (const char* exact : {"isovalue: 1", "isovalue: 1 level { level: 0 }"}) {
    EXPECT_EQ(caching_of(exact, kSome).etag, caching_of(exact, kMore).etag) << exact;
    EXPECT_EQ(caching_of(exact, kSome).headers[1].second, "public, max-age=31536000, immutable");
  }
}

}  // namespace
}  // namespace isoscope::gateway
