// What goes over the WebSocket: InteractRequest as JSON one way, and the other way one binary
// message for each InteractResponse:
//
//   u32 little-endian   length of the JSON
//   JSON                InteractResponse without its bytes, and with
//                       "image": {"type": "image/jpeg", "bytes": N}, "depthBytes": M
//   N bytes             the picture
//   M bytes             the depth grid: u16 little-endian, row by row

#ifndef ISOSCOPE_WEB_GATEWAY_FRAME_MESSAGE_H_
#define ISOSCOPE_WEB_GATEWAY_FRAME_MESSAGE_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "isoscope/v1/interact_service.pb.h"

namespace isoscope::gateway {

// The longest message of a client, in bytes.
inline constexpr std::size_t kMaxRequestBytes = std::size_t{1} << 18;

std::string EncodeFrame(isoscope::v1::InteractResponse response);

// INVALID_ARGUMENT: no JSON of an InteractRequest, or neither a state nor a frame that was shown.
absl::StatusOr<isoscope::v1::InteractRequest> DecodeInteractRequest(absl::string_view json);

// The slot of a viewer for the frame that is sent next. Thread-compatible.
class FrameSlot {
 public:
  struct Frame {
    std::int64_t frame_number = 0;
    std::string bytes;
  };

  // Puts a frame in. Returns the number of the one that it replaces, which is never sent.
  std::optional<std::int64_t> Offer(Frame frame);
  // Takes the frame out; nullopt if there is none.
  std::optional<Frame> Take();

 private:
  std::optional<Frame> frame_;
};

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_FRAME_MESSAGE_H_
