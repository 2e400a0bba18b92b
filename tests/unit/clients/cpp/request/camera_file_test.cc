#include "clients/cpp/request/camera_file.h"

#include <cmath>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "wire/proto_convert.h"

namespace isoscope::client {
namespace {

namespace v1 = isoscope::v1;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr char kGood[] =
    R"({"eye": [0, 0, 10], "target": [0, 0, 0], "up": [0, 1, 0], "perspective": {"fov_y_degrees": 30}})";

v1::Camera CameraOf(const std::string& text) {
  const auto camera = CameraFromJson(text, "c.json");
  EXPECT_THAT(camera.status(), testing::IsOk());
  return camera.value_or(v1::Camera());
}

TEST(CameraFileTest, WhatWasWrittenComesBackBitForBit) {
  int count = 0;
  for (std::uint64_t i = 0; i < 500; ++i) {
    const auto random = [&](std::uint64_t k) {
      return std::ldexp(static_cast<double>(base::RandomBits(i, k) >> 11) * 0x1p-53 - 0.5,
                        static_cast<int>(base::RandomBits(i, k + 100) % 60) - 20);
    };
    v1::Camera camera;
    *camera.mutable_eye() = wire::ToProto(math::Vec3d{random(0), random(1), random(2)});
    *camera.mutable_target() = wire::ToProto(math::Vec3d{random(3), random(4), random(5)});
    *camera.mutable_up() = wire::ToProto(math::Vec3d{random(6), random(7), random(8)});
    if (i % 2 == 0) {
      camera.mutable_perspective()->set_fov_y_degrees(0.1 + 170 * std::abs(std::sin(random(9))));
    } else {
      camera.mutable_orthographic()->set_height(std::abs(random(9)) + 1e-9);
    }
    if (!wire::CameraFromProto(camera, "camera").ok()) {
      continue;  // its up happens to be parallel to the view direction
    }
    ++count;
    const v1::Camera back = CameraOf(CameraToJson(camera));
    ASSERT_EQ(back.SerializeAsString(), camera.SerializeAsString()) << CameraToJson(camera);
  }
  EXPECT_GT(count, 300);
}

TEST(CameraFileTest, UpMayBeLeftOut) {
  const v1::Camera camera =
      CameraOf(R"({"eye": [1, 2, 3], "target": [4, 5, 6], "orthographic": {"height": 2.5}})");
  EXPECT_FALSE(camera.has_up());
  EXPECT_EQ(camera.orthographic().height(), 2.5);
  EXPECT_EQ(CameraOf(CameraToJson(camera)).SerializeAsString(), camera.SerializeAsString());
}

TEST(CameraFileTest, EveryCutOfAFileIsASentence) {
  const std::string good = kGood;
  CameraOf(good);
  for (std::size_t size = 0; size < good.size(); ++size) {
    EXPECT_THAT(CameraFromJson(good.substr(0, size), "c.json"),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("c.json: ")));
  }
}

TEST(CameraFileTest, HostileJsonIsASentenceThatNamesTheMember) {
  const std::string deep(50'000, '[');
  const std::pair<std::string, std::string> hostile[] = {
      {"[]", "JSON object"},
      {"null", "JSON object"},
      {"7", "JSON object"},
      {deep, "no valid JSON"},
      {"{\"eye\": " + deep, "no valid JSON"},
      {"\xff\xfe", "no valid JSON"},
      {R"({})", "\"eye\""},
      {R"({"eye": [0, 0, 10]})", "\"target\""},
      {R"({"eye": [0, 0], "target": [0, 0, 0], "perspective": {"fov_y_degrees": 30}})", "\"eye\""},
      {R"({"eye": [0, 0, "1"], "target": [0, 0, 0], "perspective": {"fov_y_degrees": 30}})",
       "\"eye\""},
      {R"({"eye": [0, 0, 1e999], "target": [0, 0, 0], "perspective": {"fov_y_degrees": 30}})",
       "JSON"},
      {R"({"eye": {"x": 1}, "target": [0, 0, 0], "perspective": {"fov_y_degrees": 30}})",
       "\"eye\""},
      {R"({"eye": [0, 0, 1], "target": [0, 0, 0], "up": [0, 1], "perspective": {"fov_y_degrees": 3}})",
       "\"up\""},
      {R"({"eye": [0, 0, 1], "target": [0, 0, 0]})", "expected one of"},
      {R"({"eye": [0, 0, 1], "target": [0, 0, 0], "perspective": {"fov_y_degrees": 3},
           "orthographic": {"height": 1}})",
       "expected one of"},
      {R"({"eye": [0, 0, 1], "target": [0, 0, 0], "perspective": 30})", "\"perspective\""},
      {R"({"eye": [0, 0, 1], "target": [0, 0, 0], "perspective": {}})", "fov_y_degrees"},
      {R"({"eye": [0, 0, 1], "target": [0, 0, 0], "perspective": {"fov": 30}})", "\"fov\""},
      {R"({"eye": [0, 0, 1], "target": [0, 0, 0], "perspective": {"fov_y_degrees": 180}})",
       "fov_y_degrees"},
      {R"({"eye": [0, 0, 1], "target": [0, 0, 0], "orthographic": {"height": 0}})", "height"},
      {R"({"eye": [0, 0, 1], "target": [0, 0, 1], "orthographic": {"height": 1}})", "differ"},
      {R"({"eye": [0, 1, 0], "target": [0, 0, 0], "orthographic": {"height": 1}})", "parallel"},
      {R"({"eye": [0, 0, 1], "target": [0, 0, 0], "zoom": 2, "orthographic": {"height": 1}})",
       "\"zoom\""}};
  for (const auto& [text, named] : hostile) {
    EXPECT_THAT(CameraFromJson(text, "c.json"),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         AllOf(HasSubstr("c.json: "), HasSubstr(named))))
        << text.substr(0, 100);
  }
}

TEST(CameraFileTest, FilesThatAreNoCameraAreRefusedBeforeTheyAreRead) {
  const TempDir directory;
  EXPECT_THAT(ReadCameraFile(directory.Sub("none.json")), StatusIs(absl::StatusCode::kNotFound));
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(directory.Sub("large.json"), std::string(70'000, ' ')));
  EXPECT_THAT(ReadCameraFile(directory.Sub("large.json")),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("70000 bytes")));
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(directory.Sub("c.json"), kGood));
  ISOSCOPE_EXPECT_OK(ReadCameraFile(directory.Sub("c.json")).status());
}

}  // namespace
}  // namespace isoscope::client
