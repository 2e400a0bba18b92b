#include "web-gateway/api/frame_message.h"

#include <cstdint>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

#include "core/base/coding.h"
#include "tests/support/status_matchers.h"

namespace isoscope::gateway {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
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

TEST(FrameMessageTest, ATileIsPngWithItsPlace) {
  v1::InteractResponse response;
  response.set_sequence_number(3);
  v1::Tile& tile = *response.mutable_tile();
  tile.set_png("png");
  tile.mutable_region()->set_x(64);
  tile.set_index(2);
  tile.set_count(40);
  tile.mutable_extent()->set_width_px(640);
  EXPECT_TRUE(AddsToPicture(response));
  const Parts parts = Split(EncodeFrame(response));
  EXPECT_EQ(parts.image, "png");
  EXPECT_EQ(parts.json["image"]["type"], "image/png");
  EXPECT_FALSE(parts.json["tile"].contains("png"));
  EXPECT_EQ(parts.json["tile"]["region"]["x"], 64);
  EXPECT_EQ(parts.json["tile"]["index"], 2);
  EXPECT_EQ(parts.json["tile"]["count"], 40);
  EXPECT_EQ(parts.json["tile"]["extent"]["widthPx"], 640);
}

TEST(FrameMessageTest, ADeferredFrameSaysWhatItWouldCost) {
  v1::InteractResponse response;
  response.mutable_exact_deferred()->set_expected_bytes(2'100'000'000);
  response.mutable_exact_deferred()->mutable_expected_duration()->set_seconds(40);
  response.mutable_exact_deferred()->mutable_drawn_level()->set_level(2);
  EXPECT_TRUE(AddsToPicture(response));
  const Parts parts = Split(EncodeFrame(response));
  EXPECT_EQ(parts.image + parts.depths, "");
  EXPECT_EQ(parts.json["exactDeferred"]["expectedBytes"], "2100000000");
  EXPECT_EQ(parts.json["exactDeferred"]["expectedDuration"], "40s");
  EXPECT_EQ(parts.json["exactDeferred"]["drawnLevel"]["level"], 2);
}

TEST(FrameMessageTest, AFrameStandsAloneAndAnErrorLosesNoTiles) {
  v1::InteractResponse frame;
  frame.mutable_frame()->set_png("png");
  EXPECT_FALSE(AddsToPicture(frame));
  v1::InteractResponse error;
  error.mutable_error()->set_code(14);
  EXPECT_TRUE(AddsToPicture(error));
}

TEST(FrameMessageTest, AStateMayRefine) {
  const absl::StatusOr<v1::InteractRequest> request = DecodeInteractRequest(
      R"({"viewState":{"sequenceNumber":"1","refinement":{"coarseLevels":true,"tiles":true,
          "focus":{"x":0.25,"y":0.5},"maxExactBytes":"4000000000","maxExactDuration":"10s"}}})");
  ASSERT_THAT(request, IsOk());
  const v1::Refinement& refinement = request->view_state().refinement();
  EXPECT_TRUE(refinement.coarse_levels());
  EXPECT_TRUE(refinement.tiles());
  EXPECT_EQ(refinement.focus().x(), 0.25);
  EXPECT_EQ(refinement.max_exact_bytes(), 4'000'000'000);
  EXPECT_EQ(refinement.max_exact_duration().seconds(), 10);
}

FrameQueue::Frame FrameOf(std::int64_t number) {
  return {.frame_number = number, .bytes = "frame"};
}

FrameQueue::Frame TileOf(std::int64_t number) {
  return {.frame_number = number, .adds_to_picture = true, .bytes = "tile"};
}

TEST(FrameQueueTest, ANewerFrameReplacesAllThatWait) {
  FrameQueue queue;
  EXPECT_FALSE(queue.Take().has_value());
  EXPECT_THAT(queue.Offer(FrameOf(1)), IsEmpty());
  EXPECT_THAT(queue.Offer(FrameOf(2)), ElementsAre(1));
  EXPECT_THAT(queue.Offer(TileOf(3)), IsEmpty());
  EXPECT_THAT(queue.Offer(TileOf(4)), IsEmpty());
  EXPECT_THAT(queue.Offer(FrameOf(5)), ElementsAre(2, 3, 4));
  EXPECT_EQ(queue.Take()->frame_number, 5);
  EXPECT_FALSE(queue.Take().has_value());
  EXPECT_THAT(queue.Offer(FrameOf(6)), IsEmpty());
}

TEST(FrameQueueTest, TilesWaitBehindTheFrameThatTheyAddTo) {
  FrameQueue queue;
  EXPECT_THAT(queue.Offer(FrameOf(1)), IsEmpty());
  EXPECT_THAT(queue.Offer(TileOf(2)), IsEmpty());
  EXPECT_THAT(queue.Offer(TileOf(3)), IsEmpty());
  for (const std::int64_t number : {1, 2, 3}) {
    EXPECT_EQ(queue.Take()->frame_number, number);
  }
  EXPECT_FALSE(queue.Take().has_value());
}

TEST(FrameQueueTest, ViewersThatDoNotReadHoldABoundedNumberOfTiles) {
  FrameQueue queue;
  constexpr auto kMax = static_cast<std::int64_t>(FrameQueue::kMaxFrames);
  for (std::int64_t number = 1; number <= kMax; ++number) {
    EXPECT_THAT(queue.Offer(TileOf(number)), IsEmpty());
  }
  EXPECT_THAT(queue.Offer(TileOf(kMax + 1)), ElementsAre(1));
  EXPECT_EQ(queue.Take()->frame_number, 2);
}

}  // namespace
}  // namespace isoscope::gateway
