#include "clients/cpp/connection/png_metadata.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "google/protobuf/util/message_differencer.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

#include "clients/cpp/picture_file/png_chunks.h"
#include "core/base/sha256.h"
#include "core/image/png_codec.h"
#include "tests/support/status_matchers.h"

namespace isoscope::client {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;
using Json = nlohmann::ordered_json;
namespace v1 = isoscope::v1;

std::string SmallPng() {
  const std::vector<image::Rgba8> pixels(6, image::Rgba8{1, 2, 3, 255});
  return image::EncodePng(3, 2, pixels);
}

PictureRecord SampleRecord() {
  PictureRecord record;
  record.picture_revision = "2 cpu";
  record.samples_digest = "00112233445566778899aabbccddeeff";
  record.request.set_isovalue(0.1);
  record.request.mutable_camera()->mutable_eye()->set_x(1.0 / 3);
  record.request.mutable_camera()->mutable_eye()->set_z(-1e-300);
  record.request.mutable_camera()->mutable_perspective()->set_fov_y_degrees(30);
  record.request.mutable_viewport()->set_width_px(3);
  record.request.mutable_viewport()->set_height_px(2);
  record.request.mutable_base_color()->set_red(0.3F);
  return record;
}

TEST(PngMetadataTest, TextStaysAsDocumented) {
  // Written out: pictures of today must be read tomorrow.
  EXPECT_EQ(EncodePictureRecord(SampleRecord()),
            R"({"format":"isoscope-picture","format_version":1,"picture_revision":"2 cpu",)"
            R"("samples_digest":"00112233445566778899aabbccddeeff","request":{"isovalue":0.1,)"
            R"("camera":{"eye":{"x":0.3333333333333333,"z":-1e-300},)"
            R"("perspective":{"fov_y_degrees":30}},"viewport":{"width_px":3,"height_px":2},)"
            R"("base_color":{"red":0.3}}})");
}

TEST(PngMetadataTest, RecordComesBackBitForBitAndThePictureWithoutIt) {
  PictureRecord record = SampleRecord();
  for (const bool is_annotated : {false, true}) {
    if (is_annotated) {
      record.annotated =
          AnnotatedPicture{.plain_png_sha256 = base::Sha256Hex("x"),
                           .boxes = {{.begin_x = 1, .begin_y = 2, .end_x = 3, .end_y = 4}}};
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string png, AddPictureRecord(SmallPng(), record));
    EXPECT_NE(png, SmallPng());
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::RgbaImage pixels, image::DecodePng(png));
    EXPECT_EQ(pixels, image::DecodePng(SmallPng()).value());
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RecordedPng split, SplitRecordedPng(png));
    EXPECT_EQ(split.plain_png, SmallPng());
    EXPECT_EQ(split.record.picture_revision, record.picture_revision);
    EXPECT_EQ(split.record.samples_digest, record.samples_digest);
    EXPECT_EQ(split.record.annotated, record.annotated);
    EXPECT_EQ(split.record.request.SerializeAsString(), record.request.SerializeAsString());
  }
}

TEST(PngMetadataTest, NamesSeedsAndCullingStayOut) {
  PictureRecord record = SampleRecord();
  const std::string text = EncodePictureRecord(record);
  record.request.set_dataset("patient-17");
  record.request.set_culling(v1::CULLING_NONE);
  record.request.set_ray_seed(12345);
  record.request.set_with_trace(true);
  record.request.set_with_notes(true);
  record.request.set_with_unresolved_count(true);
  EXPECT_EQ(EncodePictureRecord(record), text);
  EXPECT_EQ(DecidingPart(record.request).SerializeAsString(),
            SampleRecord().request.SerializeAsString());
}

TEST(PngMetadataTest, MembersOfANewerVersionAreNamed) {
  const Json good = Json::parse(EncodePictureRecord(SampleRecord()));
  const auto expect_refused = [](const Json& json, const std::string& name) {
    EXPECT_THAT(DecodePictureRecord(json.dump()),
                StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr(name)))
        << json;
  };
  Json json = good;
  json["shadow"] = 1;
  expect_refused(json, "'shadow'");
  json = good;
  json["format_version"] = 2;
  expect_refused(json, "format_version 2");
  json = good;
  json["request"]["fog"] = 1;
  expect_refused(json, "fog");
  json = good;
  json["request"]["camera"]["shift"] = {{"x", 1}};
  expect_refused(json, "shift");
  json = good;
  json["annotated"] = {{"plain_png_sha256", ""}, {"boxes", Json::array()}, {"ink", 1}};
  expect_refused(json, "'annotated.ink'");
}

TEST(PngMetadataTest, EveryDamageIsAnErrorAndNoCrash) {
  const std::string text = EncodePictureRecord(SampleRecord());
  for (std::size_t size = 0; size < text.size(); ++size) {
    EXPECT_THAT(DecodePictureRecord(text.substr(0, size)), StatusIs(absl::StatusCode::kDataLoss));
  }
  const Json good = Json::parse(text);
  for (const char* member : {"format", "picture_revision", "samples_digest", "request"}) {
    for (const Json& value : {Json(nullptr), Json(7), Json::array(), Json(true)}) {
      Json json = good;
      json[member] = value;
      EXPECT_THAT(DecodePictureRecord(json.dump()), StatusIs(absl::StatusCode::kDataLoss)) << json;
    }
  }
  for (const char* boxes : {"1", "[1]", "[[1,2,3]]", "[[1,2,3,-4]]", "[[1,2,3,4.5]]",
                            "[[1,2,3,99999999999]]", "[[1,2,3,\"4\"]]"}) {
    Json json = good;
    json["annotated"] = {{"plain_png_sha256", ""}, {"boxes", Json::parse(boxes)}};
    EXPECT_THAT(DecodePictureRecord(json.dump()), StatusIs(absl::StatusCode::kDataLoss)) << json;
  }
  EXPECT_THAT(DecodePictureRecord(std::string(1 << 19, '[')),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("levels")));
  EXPECT_THAT(DecodePictureRecord(std::string((1 << 20) + 1, ' ')),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("bytes")));
  EXPECT_THAT(DecodePictureRecord("\xff\xfe{}"), StatusIs(absl::StatusCode::kDataLoss));
}

TEST(PngMetadataTest, PngWithoutARecordIsNotFoundAndNoPngIsDataLoss) {
  EXPECT_THAT(SplitRecordedPng(SmallPng()),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("--no-metadata")));
  EXPECT_THAT(SplitRecordedPng("GIF89a"), StatusIs(absl::StatusCode::kDataLoss));
  EXPECT_THAT(AddPictureRecord("GIF89a", SampleRecord()), StatusIs(absl::StatusCode::kDataLoss));
}

// The small PNG with a text chunk after its header.
std::string WithChunk(absl::string_view type, absl::string_view data) {
  const std::string png = SmallPng();
  constexpr std::size_t kHeadBytes = 8 + 25;
  return png.substr(0, kHeadBytes) + MakePngChunk(type, data) + png.substr(kHeadBytes);
}

TEST(PngMetadataTest, TextOfOtherProgramsIsLeftAloneAndCopiesOfTheRecordAreRead) {
  const std::string other = WithChunk("tEXt", absl::string_view("Comment\0isoscope", 16));
  EXPECT_THAT(SplitRecordedPng(other), StatusIs(absl::StatusCode::kNotFound));
  const std::string text = EncodePictureRecord(SampleRecord());
  // As programs write it that copy text into tEXt.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const RecordedPng copied,
      SplitRecordedPng(WithChunk("tEXt", std::string("isoscope\0", 9) + text)));
  EXPECT_EQ(copied.record.picture_revision, "2 cpu");
  EXPECT_EQ(copied.plain_png, SmallPng());
  for (const std::string& damaged :
       {std::string("isoscope\0\1\0\0\0xx", 15), std::string("isoscope\0\0\0", 11),
        std::string("isoscope\0\0", 10), std::string("isoscope\0\0\0en", 13)}) {
    EXPECT_THAT(SplitRecordedPng(WithChunk("iTXt", damaged)),
                StatusIs(absl::StatusCode::kDataLoss));
  }
  EXPECT_THAT(SplitRecordedPng(WithChunk("zTXt", std::string("isoscope\0\0xx", 12))),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("compressed")));
}

TEST(PngMetadataTest, TheLevelComesBack) {
  PictureRecord record = SampleRecord();
  record.request.mutable_level()->set_level(2);
  record.drawn_level.emplace();
  record.drawn_level->set_level(2);
  record.drawn_level->set_max_spacing_px(1.0 / 3);
  record.drawn_level->mutable_spacing()->set_x(4);
  const std::string text = EncodePictureRecord(record);
  EXPECT_THAT(text, HasSubstr(R"("level":{"level":2})"));
  EXPECT_THAT(text, HasSubstr(R"("drawn_level":{"level":2,"max_spacing_px":0.3333333333333333,)"
                              R"("spacing":{"x":4}}})"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const PictureRecord back, DecodePictureRecord(text));
  EXPECT_EQ(back.request.SerializeAsString(), record.request.SerializeAsString());
  ASSERT_TRUE(back.drawn_level.has_value());
  EXPECT_EQ(back.drawn_level->SerializeAsString(), record.drawn_level->SerializeAsString());
}

}  // namespace
}  // namespace isoscope::client
