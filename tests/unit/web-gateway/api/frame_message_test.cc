#include "web-gateway/api/frame_message.h"

#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

#include "core/base/coding.h"
#include "tests/support/status_matchers.h"

namespace isoscope::gateway {
namespace {

using ::testing::HasSubstr;
using testing::IsOk;
using testing::StatusIs;
namespace v1 = isoscope::v1;

struct Parts {
  nlohmann::json json;
  std::string image;
  std::string depths;
};

// Takes a message apart as a page does.
Parts Split(const std::string& message) {
  Parts parts;
  EXPECT_GE(message.size(), 4U);
  const auto size = base::LoadLittleEndian<std::uint32_t>(message.data());
  EXPECT_LE(4 + size, message.size());
  parts.json = nlohmann::json::parse(message.substr(4, size), nullptr, false);
  EXPECT_FALSE(parts.json.is_discarded()) << message.substr(4, size);
  const auto image_bytes = parts.json["image"]["bytes"].get<std::size_t>();
  const auto depth_bytes = parts.json["depthBytes"].get<std::size_t>();
  EXPECT_EQ(message.size(), 4 + size + image_bytes + depth_bytes);
  parts.image = message.substr(4 + size, image_bytes);
  parts.depths = message.substr(4 + size + image_bytes);
  return parts;
}

TEST(FrameMessageTest, AMovingFrameHasJsonThenJpegThenDepths) {
  v1::InteractResponse response;
  response.set_sequence_number(7);
  response.set_frame_number(9);
  response.mutable_frame()->set_jpeg(std::string("\xff\xd8\0jpeg", 7));
  response.mutable_frame()->mutable_camera()->mutable_eye()->set_x(3);
  response.mutable_depth_grid()->set_width(1);
  response.mutable_depth_grid()->set_height(1);
  response.mutable_depth_grid()->set_depths(std::string("\0\x01", 2));
  const Parts parts = Split(EncodeFrame(response));
  EXPECT_EQ(parts.image, response.frame().jpeg());
  EXPECT_EQ(parts.depths, response.depth_grid().depths());
  EXPECT_EQ(parts.json["sequenceNumber"], "7");
  EXPECT_EQ(parts.json["frameNumber"], "9");
  EXPECT_EQ(parts.json["image"]["type"], "image/jpeg");
  EXPECT_EQ(parts.json["frame"]["camera"]["eye"]["x"], 3);
  EXPECT_FALSE(parts.json["frame"].contains("jpeg"));
  EXPECT_FALSE(parts.json["depthGrid"].contains("depths"));
}

TEST(FrameMessageTest, AnExactFrameIsPng) {
  v1::InteractResponse response;
  response.set_is_exact(true);
  response.mutable_frame()->set_png("png");
  const Parts parts = Split(EncodeFrame(response));
  EXPECT_EQ(parts.image, "png");
  EXPECT_EQ(parts.json["image"]["type"], "image/png");
  EXPECT_EQ(parts.json["isExact"], true);
  EXPECT_FALSE(parts.json["frame"].contains("png"));
}

TEST(FrameMessageTest, AnErrorHasNoBytes) {
  v1::InteractResponse response;
  response.mutable_error()->set_code(14);
  response.mutable_error()->set_message("gone");
  const Parts parts = Split(EncodeFrame(response));
  EXPECT_EQ(parts.json["error"]["code"], 14);
  EXPECT_EQ(parts.json["error"]["message"], "gone");
  EXPECT_EQ(parts.image + parts.depths, "");
  EXPECT_EQ(Split(EncodeFrame(v1::InteractResponse())).json["depthBytes"], 0);
}

TEST(FrameMessageTest, RequestsAreStatesOrFramesShown) {
  const absl::StatusOr<v1::InteractRequest> state = DecodeInteractRequest(
      R"({"viewState":{"sequenceNumber":"12","frame":{"isovalue":60},"isAtRest":true}})");
  ASSERT_THAT(state, IsOk());
  EXPECT_EQ(state->view_state().sequence_number(), 12);
  EXPECT_TRUE(state->view_state().is_at_rest());
  const absl::StatusOr<v1::InteractRequest> shown =
      DecodeInteractRequest(R"({"frameShown":{"frameNumber":"7","decodeDuration":"0.0042s"}})");
  ASSERT_THAT(shown, IsOk());
  EXPECT_EQ(shown->frame_shown().frame_number(), 7);
  EXPECT_EQ(shown->frame_shown().decode_duration().nanos(), 4200000);
  for (const char* wrong : {"", "{}", "null", "[1]", R"({"viewState":1})", R"({"other":{}})",
                            R"({"viewState":{},"frameShown":{}})"}) {
    EXPECT_THAT(DecodeInteractRequest(wrong).status(), StatusIs(absl::StatusCode::kInvalidArgument))
        << wrong;
  }
}

TEST(FrameMessageTest, TheSlotNamesTheFrameThatANewerOneReplaces) {
  FrameSlot slot;
  EXPECT_FALSE(slot.Take().has_value());
  EXPECT_EQ(slot.Offer({.frame_number = 1, .bytes = "a"}), std::nullopt);
  EXPECT_EQ(slot.Offer({.frame_number = 2, .bytes = "b"}), 1);
  EXPECT_EQ(slot.Offer({.frame_number = 5, .bytes = "c"}), 2);
  EXPECT_EQ(slot.Take()->bytes, "c");
  EXPECT_FALSE(slot.Take().has_value());
  EXPECT_EQ(slot.Offer({.frame_number = 6, .bytes = "d"}), std::nullopt);
}

}  // namespace
}  // namespace isoscope::gateway
