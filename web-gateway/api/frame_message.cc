#include "web-gateway/api/frame_message.h"

#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "web-gateway/api/json.h"

namespace isoscope::gateway {

namespace v1 = isoscope::v1;

std::string EncodeFrame(v1::InteractResponse response) {
  std::string image;
  absl::string_view type = "image/png";
  if (response.has_frame()) {
    if (!response.frame().jpeg().empty()) {
      type = "image/jpeg";
      image = std::move(*response.mutable_frame()->mutable_jpeg());
    } else {
      image = std::move(*response.mutable_frame()->mutable_png());
    }
    response.mutable_frame()->clear_jpeg();
    response.mutable_frame()->clear_png();
  } else if (response.has_tile()) {
    image = std::move(*response.mutable_tile()->mutable_png());
    response.mutable_tile()->clear_png();
  }
  std::string depths;
  if (response.has_depth_grid()) {
    depths = std::move(*response.mutable_depth_grid()->mutable_depths());
    response.mutable_depth_grid()->clear_depths();
  }
  std::string json = ToJson(response);
  json.pop_back();  // '}'
  absl::StrAppend(&json, json.size() > 1 ? "," : "", "\"image\":{\"type\":\"", type,
                  "\",\"bytes\":", image.size(), "},\"depthBytes\":", depths.size(), "}");
  std::string message;
  message.reserve(sizeof(std::uint32_t) + json.size() + image.size() + depths.size());
  base::AppendLittleEndian(static_cast<std::uint32_t>(json.size()), &message);
  message += json;
  message += image;
  message += depths;
  return message;
}

absl::StatusOr<v1::InteractRequest> DecodeInteractRequest(absl::string_view json) {
  v1::InteractRequest request;
  ISOSCOPE_RETURN_IF_ERROR(FromJson(json, &request));
  if (request.kind_case() == v1::InteractRequest::KIND_NOT_SET) {
    return absl::InvalidArgumentError(
        "the message has neither viewState nor frameShown: it must have one");
  }
  return request;
}

bool AddsToPicture(const v1::InteractResponse& response) { return !response.has_frame(); }

std::vector<std::int64_t> FrameQueue::Offer(Frame frame) {
  std::vector<std::int64_t> dropped;
  while (!frames_.empty() && (!frame.adds_to_picture || frames_.size() >= kMaxFrames)) {
    dropped.push_back(frames_.front().frame_number);
    frames_.pop_front();
  }
  frames_.push_back(std::move(frame));
  return dropped;
}

std::optional<FrameQueue::Frame> FrameQueue::Take() {
  if (frames_.empty()) {
    return std::nullopt;
  }
  std::optional<Frame> oldest(std::move(frames_.front()));
  frames_.pop_front();
  return oldest;
}

}  // namespace isoscope::gateway
